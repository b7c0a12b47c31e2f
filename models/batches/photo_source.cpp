// See photo_source.h.
#include "models/batches/photo_source.h"

#include <algorithm>
#include <numeric>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

/// [C,H,W] of [H,W,C] bytes.
Tensor planar(const std::vector<uint8_t>& pixels, int channels, int height, int width) {
  const size_t plane = static_cast<size_t>(height) * static_cast<size_t>(width);
  std::vector<uint8_t> out(plane * static_cast<size_t>(channels));
  for (size_t i = 0; i < plane; i++)
    for (size_t c = 0; c < static_cast<size_t>(channels); c++)
      out[c * plane + i] = pixels[i * static_cast<size_t>(channels) + c];
  return from_host(out, {channels, height, width});
}

}  // namespace

PhotoSource::PhotoSource(const Scene& scene, const Pixels& pixels) {
  for (const FramePixels& f : pixels.frames)
    photographs_.push_back({planar(f.rgba, 4, f.height, f.width),
                            f.mask.empty() ? Tensor() : from_host(f.mask, {f.height, f.width}),
                            pixels.cameras[static_cast<size_t>(f.camera)], scene.frames[f.frame].world_from_camera});
  if (photographs_.empty()) throw Error(Fault::data, "no training image is left");
}

size_t PhotoSource::draw(uint64_t seed, int64_t step, const Share& share) const {
  const auto count = static_cast<int64_t>(photographs_.size()), place = (step - 1) * share.ranks + share.rank;
  const std::vector<float> keys = random_uniform({count}, {seed, static_cast<uint32_t>(place / count), 0}).to_host();
  std::vector<size_t> order(keys.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return keys[a] < keys[b]; });
  return order[static_cast<size_t>(place % count)];
}

}  // namespace cloam
