// See point_ply.h.
#include "models/scene/point_ply.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint8_t kGrey = 128;  // of points without a colour

std::uint8_t colour(float value, float white) {
  if (!std::isfinite(value)) return kGrey;
  return static_cast<std::uint8_t>(std::lround(std::clamp(255 * double(value) / double(white), 0.0, 255.0)));
}

}  // namespace

PlyRow point_rows(const PlyHeader& header, PointCloud& cloud) {
  const std::array<std::size_t, 3> place{header.index("x"), header.index("y"), header.index("z")};
  std::vector<std::size_t> paint;
  for (const char* name : {"red", "green", "blue"}) {
    if (const auto found = header.find(name)) paint.push_back(*found);
  }
  std::array<float, 3> white{};
  if (paint.size() == 3) {
    for (std::size_t i = 0; i < 3; ++i) white[i] = header.properties[paint[i]].white;
  }
  return [=, &cloud](std::span<const float> row) {
    if (!std::all_of(place.begin(), place.end(), [&](std::size_t i) { return std::isfinite(row[i]); })) return;
    for (const std::size_t i : place) cloud.positions.push_back(row[i]);
    for (std::size_t i = 0; i < 3; ++i) {
      cloud.colours.push_back(paint.size() == 3 ? colour(row[paint[i]], white[i]) : kGrey);
    }
  };
}

void write_point_ply(const std::filesystem::path& path, const PointCloud& cloud) {
  std::string bytes = text("ply\nformat binary_little_endian 1.0\nelement vertex ", cloud.count(), "\n");
  for (const char* name : {"x", "y", "z"}) bytes += text("property float ", name, "\n");
  for (const char* name : {"red", "green", "blue"}) bytes += text("property uchar ", name, "\n");
  bytes += "end_header\n";
  const auto append = [&](const auto* three) { bytes.append(reinterpret_cast<const char*>(three), 3 * sizeof *three); };
  for (std::size_t i = 0; i < cloud.positions.size(); i += 3) {
    append(&cloud.positions[i]);
    append(&cloud.colours[i]);
  }
  commit_text(path, bytes);
}

}  // namespace cloam
