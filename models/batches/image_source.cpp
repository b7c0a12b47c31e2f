// See image_source.h.
#include "models/batches/image_source.h"

#include <algorithm>
#include <numeric>

#include "models/batches/own_rows.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr float kLeastAhead = 1e-3f;  // of a unit direction: beyond it a depth says nothing of the distance

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

PixelSource::PixelSource(const Scene& scene, const PhotoStore& photos, const SceneFrame& frame, const RayRange& range)
    : frame_(frame), range_(range) {
  std::vector<int32_t> first_direction, frames;
  std::vector<float> directions, widths, poses;
  for (const Camera& camera : photos.listed().cameras) {
    first_direction.push_back(static_cast<int32_t>(directions.size() / 3));
    const std::vector<float> d = unit_directions(camera);
    directions.insert(directions.end(), d.begin(), d.end());
    const std::vector<float> w = pixel_widths(d, camera.width, camera.height);
    widths.insert(widths.end(), w.begin(), w.end());
  }
  std::vector<uint8_t> rgba, mask;
  std::vector<float> depths;
  const auto [masked, has_depths] = photos.planes();
  for (size_t place = 0; place < photos.size(); ++place) {
    const std::shared_ptr<const FramePixels> photo = photos[place];
    const FramePixels& f = *photo;
    const size_t count = f.rgba.size() / 4;
    frames.insert(frames.end(), {static_cast<int32_t>(rgba.size() / 4), static_cast<int32_t>(count),
                                 first_direction[static_cast<size_t>(f.camera)], scene.frames[f.frame].camera});
    append_pose(poses, scene.frames[f.frame].world_from_camera, frame);
    rgba.insert(rgba.end(), f.rgba.begin(), f.rgba.end());
    if (masked && f.mask.empty()) mask.insert(mask.end(), count, 255);
    mask.insert(mask.end(), f.mask.begin(), f.mask.end());
    if (has_depths && f.depth.empty()) depths.insert(depths.end(), count, 0.f);
    for (const float depth : f.depth) depths.push_back(depth * static_cast<float>(frame.scale));
  }
  if (frames.empty()) throw Error(Fault::data, "no training image is left");
  const auto frame_count = static_cast<int64_t>(photos.size()), pixel_count = static_cast<int64_t>(rgba.size() / 4);
  if (pixel_count > int64_t{1} << 29)
    throw Error(Fault::memory, text(pixel_count, " training pixels are more than fit: use a larger --downscale"));
  rgba_ = from_host(rgba, {pixel_count, 4});
  if (masked) mask_ = from_host(mask, {pixel_count});
  if (has_depths) depth_ = from_host(depths, {pixel_count});
  directions_ = from_host(directions, {static_cast<int64_t>(directions.size() / 3), 3});
  widths_ = from_host(widths, {static_cast<int64_t>(widths.size())});
  poses_ = from_host(poses, {frame_count, 12});
  frames_ = from_host(frames, {frame_count, 4});
}

PixelBatch PixelSource::draw(int64_t count, const RandomKey& key, const Share& share,
                             const LearnedCameras& learned) const {
  const Tensor frame = own_rows(random_below({count}, frames_.dim(0), key), share);
  const Tensor place = own_rows(random_uniform({count}, {key.seed, key.step, key.stream + 1}), share);
  const Tensor record = gather_rows(frames_, frame);
  const auto column = [&](int i) { return reshape(slice(record, 1, i, i + 1), {share.size(count)}); };
  const Tensor inside = minimum(cast(place * cast(column(1), DType::f32), DType::i32), column(1) - 1);
  const Tensor pixel = column(0) + inside;
  PixelBatch out;
  const Tensor direction = column(2) + inside;
  Tensor towards = gather_rows(directions_, direction);
  out.widths = gather_rows(widths_, direction);
  if (learned.narrowing) {
    const Tensor own = gather_rows(learned.narrowing, column(3));
    towards = concat({slice(towards, 1, 0, 2) * own, slice(towards, 1, 2, 3)}, 1);
    towards = towards / sqrt(sum(square(towards), {{1}, true}));
    out.widths = out.widths * reshape(stop_gradient(own), out.widths.shape());
  }
  out.rays = world_rays(towards, gather_rows(learned.poses ? learned.poses : poses_, frame), frame_, range_);
  out.rgba = cast(gather_rows(rgba_, pixel), DType::f32) * (1.f / 255.f);
  if (mask_) out.used = cast(gather_rows(mask_, pixel) > 0, DType::f32);
  if (depth_) {
    const Tensor ahead = reshape(slice(towards, 1, 2, 3), {share.size(count)});
    out.depths = where(ahead > kLeastAhead, gather_rows(depth_, pixel) / maximum(ahead, kLeastAhead), 0.f);
  }
  return out;
}

PhotoSource::PhotoSource(const Scene& scene, const Pixels& pixels) {
  for (const FramePixels& f : pixels.frames)
    photographs_.push_back({planar(f.rgba, 4, f.height, f.width),
                            f.mask.empty() ? Tensor() : from_host(f.mask, {f.height, f.width}),
                            f.depth.empty() ? Tensor() : from_host(f.depth, {f.height, f.width}),
                            pixels.cameras[static_cast<size_t>(f.camera)], scene.frames[f.frame].world_from_camera,
                            scene.frames[f.frame].camera});
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
