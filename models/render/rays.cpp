// Rays from cameras.
#include "models/render/rays.h"

#include <cmath>

#include "runtime/ops/volume.h"

namespace cloam {
namespace {

/// [R,2] entry and exit of the box [-1,1]^3 by slabs (Kay and Kajiya 1986); a ray that misses has far < near.
Tensor box_span(const Tensor& origins, const Tensor& directions) {
  const Tensor safe = where(abs(directions) < 1e-9f, Tensor(1e-9f), directions);
  const Tensor a = (-1.f - origins) / safe, b = (1.f - origins) / safe;
  const Tensor near = maximum(max(minimum(a, b), {{1}, true}), 0.f), far = min(maximum(a, b), {{1}, true});
  return concat({near, far}, 1);
}

}  // namespace

std::vector<float> unit_directions(const Camera& camera) {
  std::vector<float> d = pixel_directions(camera);
  for (size_t i = 0; i < d.size(); i += 3) {
    const float length = std::sqrt(d[i] * d[i] + d[i + 1] * d[i + 1] + d[i + 2] * d[i + 2]);
    for (size_t k = 0; k < 3; k++) d[i + k] /= length;
  }
  return d;
}

void append_pose(std::vector<float>& poses, const Eigen::Matrix4d& world_from_camera, const SceneFrame& frame) {
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++) poses.push_back(static_cast<float>(world_from_camera(row, column)));
  const Eigen::Vector3d origin = (world_from_camera.block<3, 1>(0, 3) - frame.centre) * frame.scale;
  for (int row = 0; row < 3; row++) poses.push_back(static_cast<float>(origin[row]));
}

Rays world_rays(const Tensor& directions, const Tensor& poses, const SceneFrame& frame, const RayRange& range) {
  const int64_t rays = directions.dim(0), count = poses.dim(0);
  Rays out;
  out.directions = sum(reshape(slice(poses, 1, 0, 9), {count, 3, 3}) * unsqueeze(directions, 1), {{2}});
  out.origins = broadcast_to(slice(poses, 1, 9, 12), {rays, 3});
  out.span = frame.contract ? broadcast_to(from_host(std::vector<float>{range.near, range.far}, {1, 2}), {rays, 2})
                            : box_span(out.origins, out.directions);
  return out;
}

Rays view_rays(const View& view, const SceneFrame& frame, const RayRange& range) {
  std::vector<float> pose;
  append_pose(pose, view.world_from_camera, frame);
  const Tensor directions =
      from_host(unit_directions(view.camera), {int64_t{view.camera.width} * view.camera.height, 3});
  return world_rays(directions, from_host(pose, {1, 12}), frame, range);
}

}  // namespace cloam
