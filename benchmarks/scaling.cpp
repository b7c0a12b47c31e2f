// See scaling.h.
#include "benchmarks/scaling.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "runtime/error.h"

namespace cloam {
namespace {

struct Family {
  const char *prefix, *suffix, *unit;
};
/// The size is the last number between prefix and suffix.
constexpr Family kFamilies[] = {
    {"mlp.4x64.", ".fwd", "samples"},
    {"mlp.4x64.", ".fwdbwd", "samples"},
    {"splat_blend.", ".fwd", "splats in tiles"},
    {"splat_blend.", ".fwdbwd", "splats in tiles"},
    {"hashgrid.", ".fwd", "points"},
    {"hashgrid.", ".fwdbwd", "points"},
};

/// "65536", "400k" (of 1024), "1m"; 0 for what is no such number.
double size_of(const std::string& field) {
  char* end = nullptr;
  const double value = std::strtod(field.c_str(), &end);
  const std::string unit = end;
  if (end == field.c_str()) return 0;
  return unit.empty() ? value : unit == "k" ? 0x1p10 * value : unit == "m" ? 0x1p20 * value : 0;
}

/// Of a workload of the family; 0 for others.
double size_in(const std::string& name, const Family& family) {
  if (!name.starts_with(family.prefix) || !name.ends_with(family.suffix)) return 0;
  const std::string rest = name.substr(0, name.size() - std::strlen(family.suffix));
  return size_of(rest.substr(rest.rfind('.') + 1));
}

/// The plot's frame in pixels, and decades on both axes.
struct Frame {
  double left = 70, right = 560, top = 32, bottom = 340;
  double x0, x1, y0, y1;  // exponents of ten
  double x(double size) const { return left + (std::log10(size) - x0) / (x1 - x0) * (right - left); }
  double y(double ns) const { return bottom - (std::log10(ns) - y0) / (y1 - y0) * (bottom - top); }
};

Frame frame_of(const std::vector<Series>& all) {
  Frame out;
  out.x0 = out.y0 = 1e9;
  out.x1 = out.y1 = -1e9;
  for (const Series& series : all)
    for (const Series::Point& p : series.points) {
      out.x0 = std::min(out.x0, std::floor(std::log10(p.size)));
      out.x1 = std::max(out.x1, std::ceil(std::log10(p.size)));
      out.y0 = std::min(out.y0, std::floor(std::log10(p.ns)));
      out.y1 = std::max(out.y1, std::ceil(std::log10(p.ns)));
    }
  out.y1 = std::max(out.y1, out.y0 + 1);
  return out;
}

constexpr char kStyle[] =
    "<style>text{font:12px sans-serif;fill:#333}.grid{stroke:#ccc}polyline{fill:none;stroke-width:2}"
    "@media(prefers-color-scheme:dark){text{fill:#ddd}.grid{stroke:#555}}</style>\n";
constexpr const char* kColours[] = {"#3b7dd8", "#e07b39", "#3f9e5a", "#b85fc4", "#c9a227", "#4fb3bf"};

std::string line(double x1, double y1, double x2, double y2) {
  return text("<line class=\"grid\" x1=\"", x1, "\" y1=\"", y1, "\" x2=\"", x2, "\" y2=\"", y2, "\"/>\n");
}

std::string label(double x, double y, const char* anchor, const std::string& words) {
  return text("<text x=\"", x, "\" y=\"", y, "\" text-anchor=\"", anchor, "\">", words, "</text>\n");
}

std::string axes(const Frame& f) {
  std::string out;
  for (double e = f.x0; e <= f.x1; e++) {
    const double x = f.x(std::pow(10, e));
    out += line(x, f.top, x, f.bottom) + label(x, f.bottom + 18, "middle", text(std::pow(10, e)));
  }
  for (double e = f.y0; e <= f.y1; e++) {
    const double y = f.y(std::pow(10, e));
    out += line(f.left, y, f.right, y) + label(f.left - 8, y + 4, "end", text(std::pow(10, e)));
  }
  return out + label((f.left + f.right) / 2, f.bottom + 38, "middle", "size") +
         label(f.left, f.top - 14, "end", "ns each");
}

std::string curve(const Frame& f, const Series& series, const char* colour) {
  std::string points, dots;
  for (const Series::Point& p : series.points) {
    points += text(f.x(p.size), ",", f.y(p.ns), " ");
    dots += text("<circle r=\"3\" fill=\"", colour, "\" cx=\"", f.x(p.size), "\" cy=\"", f.y(p.ns), "\"/>\n");
  }
  return text("<polyline stroke=\"", colour, "\" points=\"", points, "\"/>\n", dots);
}

}  // namespace

std::vector<Series> series_of(const std::vector<BenchRow>& rows) {
  std::vector<Series> out;
  for (const Family& family : kFamilies) {
    Series series{std::string(family.prefix) + "N" + family.suffix, family.unit, {}};
    for (const BenchRow& row : rows)
      if (const double size = size_in(row.name, family); size > 0) series.points.push_back({size, 1e6 * row.ms / size});
    std::sort(series.points.begin(), series.points.end(), [](const auto& a, const auto& b) { return a.size < b.size; });
    if (series.points.size() > 1) out.push_back(series);
  }
  return out;
}

std::string plot_of(const std::vector<Series>& all) {
  const Frame f = frame_of(all);
  std::string out = text("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 800 390\">\n", kStyle, axes(f));
  for (std::size_t i = 0; i < all.size(); i++) {
    const char* colour = kColours[i % std::size(kColours)];
    const double y = f.top + 14 + 20 * static_cast<double>(i);
    out += curve(f, all[i], colour) + text("<circle r=\"5\" fill=\"", colour, "\" cx=\"580\" cy=\"", y - 4, "\"/>\n") +
           label(592, y, "start", all[i].name);
  }
  return out + "</svg>\n";
}

}  // namespace cloam
