// See sky_region.h.
#include "models/street/sky_region.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "models/street/photo_hints.h"

namespace cloam {
namespace {

constexpr int kEdge = 6;              // of 255: neighbours in one area differ by no more in any channel
constexpr double kAlike = 26;         // of 255: areas of the sky differ by no more on average
constexpr std::size_t kOneIn = 1000;  // a photo's sky is at least one in so many of its pixels

struct Area {
  std::vector<std::size_t> pixels;
  std::size_t of_sky = 0;  // by LiDAR
  std::array<double, 3> colour = {0, 0, 0};
};

class Areas {
 public:
  Areas(const std::vector<std::uint8_t>& kinds, const FramePixels& photo)
      : photo_(photo), width_(static_cast<std::size_t>(photo.width)) {
    for (const std::uint8_t kind : kinds) open_.push_back(kind == 0 || kind == kSkyPixel);
    for (std::size_t i = 0; i < kinds.size(); ++i)
      if (open_[i] && kinds[i] == kSkyPixel) all_.push_back(from(i, kinds));
  }
  std::vector<Area>& all() { return all_; }

 private:
  Area from(std::size_t first, const std::vector<std::uint8_t>& kinds) {
    Area area;
    area.pixels.push_back(first);
    open_[first] = false;
    for (std::size_t next = 0; next < area.pixels.size(); ++next) {
      const std::size_t i = area.pixels[next], x = i % width_;
      area.of_sky += kinds[i] == kSkyPixel;
      for (std::size_t c = 0; c < 3; ++c) area.colour[c] += photo_.rgba[4 * i + c];
      if (x > 0) visit(i, i - 1, area);
      if (x + 1 < width_) visit(i, i + 1, area);
      if (i >= width_) visit(i, i - width_, area);
      if (i + width_ < open_.size()) visit(i, i + width_, area);
    }
    for (double& mean : area.colour) mean /= static_cast<double>(area.pixels.size());
    return area;
  }

  void visit(std::size_t i, std::size_t beside, Area& area) {
    if (!open_[beside]) return;
    for (std::size_t c = 0; c < 3; ++c)
      if (std::abs(int{photo_.rgba[4 * i + c]} - int{photo_.rgba[4 * beside + c]}) > kEdge) return;
    open_[beside] = false;
    area.pixels.push_back(beside);
  }

  const FramePixels& photo_;
  std::size_t width_;
  std::vector<bool> open_;
  std::vector<Area> all_;
};

}  // namespace

void follow_sky(std::vector<std::uint8_t>& kinds, const FramePixels& photo) {
  Areas areas(kinds, photo);
  std::vector<Area>& all = areas.all();
  const auto largest =
      std::max_element(all.begin(), all.end(), [](const Area& a, const Area& b) { return a.of_sky < b.of_sky; });
  if (largest == all.end() || largest->of_sky * kOneIn < kinds.size()) return;
  for (const Area& area : all) {
    double difference = 0;
    for (std::size_t c = 0; c < 3; ++c)
      difference = std::max(difference, std::abs(area.colour[c] - largest->colour[c]));
    const bool is_sky = 2 * area.of_sky >= area.pixels.size() && difference <= kAlike;
    for (const std::size_t i : area.pixels) kinds[i] = is_sky ? kSkyPixel : 0;
  }
}

}  // namespace cloam
