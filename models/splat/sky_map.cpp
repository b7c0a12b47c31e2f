// See sky_map.h.
#include "models/splat/sky_map.h"

#include "runtime/ops/cube_map.h"

namespace cloam {

Tensor directions_of(const Camera& camera) {
  return from_host(pixel_directions(camera), {int64_t{camera.height} * camera.width, 3});
}

Tensor sky_taps(const Tensor& directions, const Eigen::Matrix4d& world_from_camera, int64_t side) {
  std::vector<float> turn;
  for (int to = 0; to < 3; ++to)
    for (int from = 0; from < 3; ++from) turn.push_back(static_cast<float>(world_from_camera(to, from)));
  return cube_taps(directions, from_host(turn, {3, 3}), side);
}

Tensor nearest_taps(const Tensor& taps) {
  const Tensor ways = slice(taps, 0, 1, 3);
  return concat({slice(taps, 0, 0, 1), where(ways < kTapUnit / 2, 0, kTapUnit)}, 0);
}

Tensor sky_colours(const Tensor& faces, const Tensor& directions, const Eigen::Matrix4d& world_from_camera) {
  return cube_colours(faces, sky_taps(directions, world_from_camera, faces.dim(1)));
}

}  // namespace cloam
