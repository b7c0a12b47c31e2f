// See curves.h.
#include "cli/curves.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "models/io/commit.h"
#include "models/runs/run_folder.h"

namespace cloam {
namespace {

using Point = RunHistory::Point;
using Series = RunHistory::Series;

constexpr double kWidth = 720, kLeft = 64, kRight = 16, kTitle = 26, kBelow = 14;
constexpr int kColumns = 640;            // of the raw curve: where it has more points, the least and the greatest
constexpr double kLogarithmicFrom = 10;  // times the least: from there on a scale is logarithmic
constexpr double kSmoothed = 0.03;       // of the curve, that a smoothed value looks back over

constexpr char kStyle[] =
    "<style>svg{background:#fff}text{font:12px sans-serif;fill:#333}.title{font-weight:bold}.grid{stroke:#ddd}"
    "path{fill:none}.raw{stroke:#a9c4ea}.smooth{stroke:#1c5fb8;stroke-width:2}.dot{fill:#d1601f}.line{stroke:#d1601f}"
    "@media(prefers-color-scheme:dark){svg{background:#16181c}text{fill:#ddd}.grid{stroke:#3a3e46}.raw{stroke:#37557f}"
    ".smooth{stroke:#7db0f5}.dot{fill:#f0935c}.line{stroke:#f0935c}}</style>\n";

constexpr double kDigits[] = {1, 2, 5};  // of round numbers

/// From values to places, linear or logarithmic.
class Axis {
 public:
  Axis(double least, double most, bool logarithmic, double from, double to)
      : logarithmic_(logarithmic), least_(least), most_(most), from_(from), to_(to) {}
  double at(double value) const { return from_ + (to_ - from_) * (scaled(value) - scaled(least_)) / span(); }
  /// Round numbers within its ends.
  std::vector<double> ticks(int wanted) const;

 private:
  double scaled(double value) const { return logarithmic_ ? std::log10(value) : value; }
  double span() const { return scaled(most_) - scaled(least_); }
  bool logarithmic_;
  double least_, most_, from_, to_;
};

/// The least of 1, 2 and 5 times a power of ten that is not below.
double round_up(double value) {
  const double power = std::pow(10, std::floor(std::log10(value)));
  for (const double digit : kDigits)
    if (digit * power >= value * 0.999999) return digit * power;
  return 10 * power;
}

std::vector<double> Axis::ticks(int wanted) const {
  std::vector<double> ticks;
  if (logarithmic_) {
    const double decades = std::log10(most_ / least_);
    for (const int each : {3, 1}) {  // 1, 2 and 5, or 1 alone, of each power of ten
      ticks.clear();
      for (double power = std::pow(10, std::floor(std::log10(least_))); power <= most_; power *= 10)
        for (int i = 0; i < each; ++i)
          if (const double tick = kDigits[i] * power; tick >= least_ && tick <= most_) ticks.push_back(tick);
      if (each == 1 || each * decades <= wanted + 2) break;
    }
    if (ticks.size() > 1) return ticks;
    ticks.clear();
  }
  const double step = round_up((most_ - least_) / wanted);
  for (double value = std::ceil(least_ / step - 1e-9) * step; value <= most_ + 1e-9 * step; value += step)
    ticks.push_back(std::abs(value) < 1e-9 * step ? 0 : value);
  return ticks;
}

std::string words_for(double value) {
  if (value != 0 && (std::abs(value) < 1e-3 || std::abs(value) >= 1e7)) {
    const int power = static_cast<int>(std::floor(std::log10(std::abs(value)) + 1e-9));
    return fmt::format("{:.3g}e{}", value / std::pow(10, power), power);
  }
  std::string digits = fmt::format("{:.10g}", value);
  if (std::abs(value) >= 1000 && value == std::round(value))
    for (int at = static_cast<int>(digits.size()) - 3; at > (value < 0 ? 1 : 0); at -= 3)
      digits.insert(static_cast<std::size_t>(at), ",");
  return digits;
}

Series finite(Series series) {
  std::erase_if(series, [](const Point& point) { return !std::isfinite(point.value); });
  return series;
}

/// An exponential mean that begins without a bias.
Series smoothed(const Series& series) {
  const double keep = 1 - 1 / std::max(1.0, kSmoothed * static_cast<double>(series.size()));
  double sum = 0, weight = 0;
  Series means;
  for (const Point& point : series) {
    sum = keep * sum + point.value;
    weight = keep * weight + 1;
    means.push_back({point.step, sum / weight});
  }
  return means;
}

/// No more points than can be told apart; peaks stay.
Series thinned(const Series& series) {
  const std::size_t each = series.size() / kColumns + 1;
  if (each <= 2) return series;
  Series few;
  for (std::size_t begin = 0; begin < series.size(); begin += each) {
    const auto from = series.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto to = series.begin() + static_cast<std::ptrdiff_t>(std::min(series.size(), begin + each));
    const auto by_value = [](const Point& a, const Point& b) { return a.value < b.value; };
    auto [low, high] = std::minmax_element(from, to, by_value);
    if (high < low) std::swap(low, high);
    few.push_back(*low);
    if (high != low) few.push_back(*high);
  }
  return few;
}

struct Panel {
  std::string title;
  Series curve, dots = {};
  double height = 150;
  bool may_be_logarithmic = true, smooth = true;
};

class Drawing {
 public:
  explicit Drawing(double last_step) : steps_(0, std::max(1.0, last_step), false, kLeft, kWidth - kRight) {}

  void add(const Panel& panel) {
    const double top = bottom_ + kTitle;
    bottom_ = top + panel.height;
    const Axis values = axis_of(panel, top);
    for (const double tick : steps_.ticks(8)) line(steps_.at(tick), top, steps_.at(tick), bottom_);
    for (const double tick : values.ticks(panel.height > 100 ? 5 : 2)) {
      line(kLeft, values.at(tick), kWidth - kRight, values.at(tick));
      label(kLeft - 6, values.at(tick) + 4, "end", words_for(tick));
    }
    out_ += fmt::format("<text class=\"title\" x=\"{}\" y=\"{:.1f}\">{}</text>\n", kLeft, top - 8, panel.title);
    curve(thinned(panel.curve), values, panel.smooth ? "raw" : "smooth");
    if (panel.smooth) curve(thinned(smoothed(panel.curve)), values, "smooth");
    if (panel.dots.size() > 1) curve(panel.dots, values, "line");
    for (const Point& dot : panel.dots)
      out_ +=
          fmt::format("<circle class=\"dot\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.5\"/>\n", x(dot), values.at(dot.value));
    bottom_ += kBelow;
  }

  std::string svg() {
    for (const double tick : steps_.ticks(8)) label(steps_.at(tick), bottom_ + 2, "middle", words_for(tick));
    label((kLeft + kWidth - kRight) / 2, bottom_ + 20, "middle", "step");
    return fmt::format("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {:.0f}\" width=\"{}\">\n", kWidth,
                       bottom_ + 30, kWidth) +
           kStyle + out_ + "</svg>\n";
  }

 private:
  static Axis axis_of(const Panel& panel, double top) {
    double least = INFINITY, most = -INFINITY;
    for (const Series* series : {&panel.curve, &panel.dots})
      for (const Point& point : *series) least = std::min(least, point.value), most = std::max(most, point.value);
    const bool logarithmic = panel.may_be_logarithmic && least > 0 && most > kLogarithmicFrom * least;
    if (most - least < 1e-6 * std::abs(most) || most == least) {  // a level line in the middle
      const double room = most == 0 ? 1 : 0.1 * std::abs(most);
      least -= room, most += room;
    } else if (!logarithmic) {
      const double room = 0.05 * (most - least);
      least -= room, most += room;
    }
    return {least, most, logarithmic, top + panel.height, top};
  }
  double x(const Point& point) const { return steps_.at(static_cast<double>(point.step)); }
  void line(double x1, double y1, double x2, double y2) {
    out_ +=
        fmt::format("<line class=\"grid\" x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\"/>\n", x1, y1, x2, y2);
  }
  void label(double x, double y, const char* anchor, const std::string& words) {
    out_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>\n", x, y, anchor, words);
  }
  void curve(const Series& series, const Axis& values, const char* look) {
    std::string path;
    for (const Point& point : series)
      path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", x(point), values.at(point.value));
    if (!path.empty()) out_ += fmt::format("<path class=\"{}\" d=\"{}\"/>\n", look, path);
  }

  Axis steps_;
  double bottom_ = 0;
  std::string out_;
};

}  // namespace

std::string curves_svg(const RunHistory& history) {
  const Series loss = finite(history.loss), psnr = finite(history.psnr), rate = finite(history.rate),
               held_out = finite(history.held_out);
  double last = 0;
  for (const Series* series : {&loss, &psnr, &held_out})
    for (const Point& point : *series) last = std::max(last, static_cast<double>(point.step));
  if (loss.empty()) return "";
  Drawing drawing(last);
  drawing.add({"loss", loss});
  if (!psnr.empty() || !held_out.empty())
    drawing.add(
        {held_out.empty() ? "PSNR of training pixels, dB" : "PSNR, dB: training pixels; dots: the preview's view", psnr,
         held_out, 150, false});
  if (!rate.empty()) drawing.add({"learning rate", rate, {}, 56, true, false});
  return drawing.svg();
}

void write_curves(const std::filesystem::path& run) {
  const std::string svg = curves_svg(read_history(RunPaths{run}.events()));
  if (!svg.empty()) commit_text(RunPaths{run}.curves(), svg);
}

}  // namespace cloam
