// See sample_pictures.h.
#include "models/eval/sample_pictures.h"

#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

constexpr float kMostDecades = 3;
constexpr float kDark[] = {0.10f, 0.18f, 0.45f};  // of a sample without light

struct Ends {
  float near = 1, far = 1;
};

Ends ends_of(const std::vector<RaySample>& samples) {
  if (samples.empty()) return {};
  const auto by_distance = [](const RaySample& a, const RaySample& b) { return a.distance < b.distance; };
  const auto [near, far] = std::minmax_element(samples.begin(), samples.end(), by_distance);
  return {std::max(near->distance, far->distance * std::pow(10.f, -kMostDecades)), far->distance};
}

}  // namespace

Image sample_picture(const std::vector<RaySample>& samples, int width, int height) {
  const Ends ends = ends_of(samples);
  const float decades = std::max(std::log10(ends.far / ends.near), 1e-6f);
  std::vector<float> light(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), -1.f);
  for (const RaySample& sample : samples) {
    const float way = std::log10(std::max(sample.distance, ends.near) / ends.near) / decades;
    const long up = std::lround(std::clamp(way, 0.f, 1.f) * static_cast<float>(height - 1));
    float& pixel = light[static_cast<std::size_t>((height - 1 - up) * width + sample.column)];
    pixel = std::max(pixel, 0.f) + sample.weight;
  }
  std::vector<float> rgb;
  for (const float value : light)
    for (const float dark : kDark)
      // The root, so that a tenth of the light is seen, too.
      rgb.push_back(value < 0 ? 0.f : dark + (1 - dark) * std::sqrt(std::clamp(value, 0.f, 1.f)));
  return to_image(rgb, width, height);
}

}  // namespace cloam
