// Rays from cameras.
#include "models/render/rays.h"

#include <Eigen/Geometry>
#include <algorithm>
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

Tensor row_of(const std::vector<float>& numbers) {
  return from_host(numbers, {1, static_cast<int64_t>(numbers.size())});
}

Tensor axis(const Tensor& points, int64_t i) { return slice(points, 1, i, i + 1); }

/// [R,1]: the depth at which a ray enters: the near plane, or its camera where that lies beyond it.
Tensor first_depth(const Rays& rays) { return maximum(axis(rays.origins, 2), 1.f); }

}  // namespace

std::vector<float> unit_directions(const Camera& camera) {
  std::vector<float> d = pixel_directions(camera);
  for (size_t i = 0; i < d.size(); i += 3) {
    const float length = std::sqrt(d[i] * d[i] + d[i + 1] * d[i + 1] + d[i + 2] * d[i + 2]);
    for (size_t k = 0; k < 3; k++) d[i + k] /= length;
  }
  return d;
}

std::vector<float> pixel_widths(const std::vector<float>& directions, int width, int height) {
  const auto at = [&](int x, int y) {
    const size_t place = 3 * (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x));
    return Eigen::Vector3d(directions[place], directions[place + 1], directions[place + 2]);
  };
  std::vector<float> widths;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      // The last row and column have their neighbour on the other side; an image of one pixel has none.
      const Eigen::Vector3d here = at(x, y), right = (at(x + 1 < width ? x + 1 : std::max(x - 1, 0), y) - here),
                            down = (at(x, y + 1 < height ? y + 1 : std::max(y - 1, 0)) - here);
      widths.push_back(static_cast<float>(std::sqrt(right.cross(down).norm())));
    }
  return widths;
}

std::vector<float> normalised(const std::vector<float>& world, const SceneFrame& frame) {
  std::vector<float> points;
  points.reserve(world.size());
  for (size_t i = 0; i < world.size(); i += 3) {
    const Eigen::Vector3d at(world[i], world[i + 1], world[i + 2]);
    const Eigen::Vector3f moved = ((at - frame.centre) * frame.scale).cast<float>();
    points.insert(points.end(), moved.data(), moved.data() + 3);
  }
  return points;
}

void append_pose(std::vector<float>& poses, const Eigen::Matrix4d& world_from_camera, const SceneFrame& frame) {
  const Eigen::Matrix3d turn = frame.turn * world_from_camera.block<3, 3>(0, 0);
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++) poses.push_back(static_cast<float>(turn(row, column)));
  const Eigen::Vector3d origin = frame.turn * (world_from_camera.block<3, 1>(0, 3) - frame.centre) * frame.scale;
  for (int row = 0; row < 3; row++) poses.push_back(static_cast<float>(origin[row]));
}

Rays world_rays(const Tensor& directions, const Tensor& poses, const SceneFrame& frame, const RayRange& range) {
  const int64_t rays = directions.dim(0), count = poses.dim(0);
  Rays out;
  out.directions = sum(reshape(slice(poses, 1, 0, 9), {count, 3, 3}) * unsqueeze(directions, 1), {{2}});
  out.origins = broadcast_to(slice(poses, 1, 9, 12), {rays, 3});
  out.span = frame.contract || frame.ndc ? broadcast_to(row_of({range.near, range.far}), {rays, 2})
                                         : box_span(out.origins, out.directions);
  return out;
}

Tensor ndc_points(const Tensor& across, const Tensor& z, const SceneFrame& frame) {
  const Tensor widen = row_of({static_cast<float>(frame.widen.x()), static_cast<float>(frame.widen.y())});
  return concat({across / z * widen, 1.f - 2.f / z}, 1);
}

Rays ndc_rays(const Rays& rays, const SceneFrame& frame) {
  const Tensor forward = maximum(axis(rays.directions, 2), 1e-6f), z = first_depth(rays);
  const Tensor slope = slice(rays.directions, 1, 0, 2) / forward;
  const Tensor begin = ndc_points(slice(rays.origins, 1, 0, 2) + slope * (z - axis(rays.origins, 2)), z, frame);
  // At an infinite depth only the slope is left of across / z.
  const Tensor end = ndc_points(slope, full({rays.origins.dim(0), 1}, 1.f), frame) + row_of({0.f, 0.f, 2.f});
  const Tensor way = end - begin, length = sqrt(sum(square(way), {{1}, true}));
  Rays out{begin, way / length, Tensor()};
  const Tensor span = box_span(out.origins, out.directions);
  const Tensor sees = axis(rays.directions, 2) > 1e-6f;
  out.span = concat({axis(span, 0), where(sees, minimum(axis(span, 1), length), Tensor(-1.f))}, 1);
  return out;
}

Tensor ndc_distances(const Rays& rays, const SceneFrame& frame, const Tensor& along) {
  const Rays path = ndc_rays(rays, frame);
  // 1 - 2 / z grows evenly along the path: from its value at the first depth to 1.
  const Tensor closeness = maximum(1.f - axis(path.origins, 2) - axis(path.directions, 2) * unsqueeze(along, 1), 1e-3f);
  const Tensor distance = (2.f / closeness - axis(rays.origins, 2)) / maximum(axis(rays.directions, 2), 1e-6f);
  return reshape(distance, {along.dim(0)});
}

Rays view_rays(const View& view, const SceneFrame& frame, const RayRange& range) {
  std::vector<float> pose;
  append_pose(pose, view.world_from_camera, frame);
  const Tensor directions =
      from_host(unit_directions(view.camera), {int64_t{view.camera.width} * view.camera.height, 3});
  return world_rays(directions, from_host(pose, {1, 12}), frame, range);
}

}  // namespace cloam
