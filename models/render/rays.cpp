// Rays from cameras.
#include "models/render/rays.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

std::vector<float> unit_directions(const Camera& camera) {
  std::vector<float> d = pixel_directions(camera);
  for (size_t i = 0; i < d.size(); i += 3) {
    const float length = std::sqrt(d[i] * d[i] + d[i + 1] * d[i + 1] + d[i + 2] * d[i + 2]);
    for (size_t k = 0; k < 3; k++) d[i + k] /= length;
  }
  return d;
}

void append_pose(std::vector<float>& out, const Eigen::Matrix4d& world_from_camera, const SceneFrame& frame) {
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++) out.push_back(static_cast<float>(world_from_camera(row, column)));
  const Eigen::Vector3d origin = (world_from_camera.block<3, 1>(0, 3) - frame.centre) * frame.scale;
  for (int row = 0; row < 3; row++) out.push_back(static_cast<float>(origin[row]));
}

/// [R,2] entry and exit of the box [-1,1]^3 by slabs (Kay and Kajiya 1986); a ray that misses has far < near.
Tensor box_span(const Tensor& origins, const Tensor& directions) {
  const Tensor safe = where(abs(directions) < 1e-9f, Tensor(1e-9f), directions);
  const Tensor a = (-1.f - origins) / safe, b = (1.f - origins) / safe;
  const Tensor near = maximum(max(minimum(a, b), {{1}, true}), 0.f), far = min(maximum(a, b), {{1}, true});
  return concat({near, far}, 1);
}

/// directions [R,3] in camera axes, poses [R,12] (or [1,12]).
Rays world_rays(const Tensor& directions, const Tensor& poses, const SceneFrame& frame, const RayRange& range) {
  const int64_t rays = directions.dim(0), count = poses.dim(0);
  Rays out;
  out.directions = sum(reshape(slice(poses, 1, 0, 9), {count, 3, 3}) * unsqueeze(directions, 1), {{2}});
  out.origins = broadcast_to(slice(poses, 1, 9, 12), {rays, 3});
  out.span = frame.contract ? broadcast_to(from_host(std::vector<float>{range.near, range.far}, {1, 2}), {rays, 2})
                            : box_span(out.origins, out.directions);
  return out;
}

}  // namespace

Rays view_rays(const View& view, const SceneFrame& frame, const RayRange& range) {
  std::vector<float> pose;
  append_pose(pose, view.world_from_camera, frame);
  const Tensor directions =
      from_host(unit_directions(view.camera), {int64_t{view.camera.width} * view.camera.height, 3});
  return world_rays(directions, from_host(pose, {1, 12}), frame, range);
}

RayBank::RayBank(const Scene& scene, const Pixels& pixels, const SceneFrame& frame, const RayRange& range)
    : frame_(frame), range_(range), frame_count_(static_cast<int64_t>(pixels.frames.size())) {
  std::vector<int32_t> first_direction, frames;
  std::vector<float> directions, poses;
  for (const Camera& camera : pixels.cameras) {
    first_direction.push_back(static_cast<int32_t>(directions.size() / 3));
    const std::vector<float> d = unit_directions(camera);
    directions.insert(directions.end(), d.begin(), d.end());
  }
  std::vector<uint8_t> rgba, mask;
  bool masked = false;
  for (const FramePixels& f : pixels.frames) masked |= !f.mask.empty();
  for (const FramePixels& f : pixels.frames) {
    const size_t count = f.rgba.size() / 4;
    frames.insert(frames.end(), {static_cast<int32_t>(rgba.size() / 4), static_cast<int32_t>(count),
                                 first_direction[static_cast<size_t>(f.camera)]});
    append_pose(poses, scene.frames[f.frame].world_from_camera, frame);
    rgba.insert(rgba.end(), f.rgba.begin(), f.rgba.end());
    if (masked && f.mask.empty()) mask.insert(mask.end(), count, 255);
    mask.insert(mask.end(), f.mask.begin(), f.mask.end());
  }
  if (frames.empty()) throw Error(Fault::data, "no training image is left");
  const auto pixel_count = static_cast<int64_t>(rgba.size() / 4);
  if (pixel_count > int64_t{1} << 29)
    throw Error(Fault::memory, text(pixel_count, " training pixels are more than fit: use a larger --downscale"));
  rgba_ = from_host(rgba, {pixel_count, 4});
  if (masked) mask_ = from_host(mask, {pixel_count});
  directions_ = from_host(directions, {static_cast<int64_t>(directions.size() / 3), 3});
  poses_ = from_host(poses, {frame_count_, 12});
  frames_ = from_host(frames, {frame_count_, 3});
}

RayBatch RayBank::sample(int64_t count, const RandomKey& key) const {
  const Tensor frame = random_below({count}, frame_count_, key);
  const Tensor place = random_uniform({count}, {key.seed, key.step, key.stream + 1});
  const Tensor record = gather_rows(frames_, frame);
  const auto column = [&](int i) { return reshape(slice(record, 1, i, i + 1), {count}); };
  const Tensor inside = minimum(cast(place * cast(column(1), DType::f32), DType::i32), column(1) - 1);
  const Tensor pixel = column(0) + inside;
  RayBatch out;
  out.rays = world_rays(gather_rows(directions_, column(2) + inside), gather_rows(poses_, frame), frame_, range_);
  out.rgba = cast(gather_rows(rgba_, pixel), DType::f32) * (1.f / 255.f);
  if (mask_) out.used = cast(gather_rows(mask_, pixel) > 0, DType::f32);
  return out;
}

}  // namespace cloam
