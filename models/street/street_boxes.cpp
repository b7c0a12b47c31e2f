// See street_boxes.h.
#include "models/street/street_boxes.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace cloam {
namespace {

constexpr float kPadding[] = {0.125f, 0.125f, 0.05f};  // metres added to a box's half sizes (UniSim)
constexpr float kCube = 1.1f;                          // a box's cube over its longest side

/// Columns of the rotation are rows of its inverse.
StreetBox box_of(const Eigen::Matrix4d& street_from_box, const Eigen::Vector3d& size, size_t owner) {
  StreetBox box{{}, {}, {}, cube_scale(size), static_cast<float>(owner)};
  Eigen::Map<Eigen::Matrix3f>(box.box_from_street.data()) = street_from_box.topLeftCorner<3, 3>().cast<float>();
  Eigen::Map<Eigen::Vector3f>(box.centre.data()) = street_from_box.topRightCorner<3, 1>().cast<float>();
  Eigen::Map<Eigen::Vector3f>(box.half_size.data()) = (size / 2).cast<float>() + Eigen::Vector3f(kPadding);
  return box;
}

}  // namespace

float cube_scale(const Eigen::Vector3d& size) {
  return 1.f / (kCube * static_cast<float>(std::max(0.5, size.maxCoeff())));
}

StreetBoxes boxes_of(const std::vector<Actor>& actors, const RayList& rays, const StreetSpace& space) {
  std::vector<std::vector<StreetBox>> moments;
  for (const double time : rays.times) {
    moments.emplace_back();
    for (size_t a = 0; a < actors.size(); ++a) {
      if (!rays.actors.empty() && !rays.actors[a]) continue;
      if (const auto pose = world_from_box_at(actors[a], time))
        moments.back().push_back(box_of(space.street_from_world() * *pose, actors[a].size, a));
    }
  }
  return pack_boxes(moments);
}

StreetBoxes single_box(const Eigen::Vector3d& size) {
  return pack_boxes({{box_of(Eigen::Matrix4d::Identity(), size, 0)}});
}

StreetGrid sky_of(const StreetGrid& grid) {
  std::vector<float> numbers = grid.numbers.to_host();
  for (size_t k = 0; k < 3; ++k) numbers[k] = 1e6f, numbers[4 + k] = 1;  // one voxel, far away
  const Tensor nothing = from_host(std::vector<uint8_t>{0}, {1, 1, 1});
  return {nothing, nothing, from_host(numbers, grid.numbers.shape())};
}

}  // namespace cloam
