// Where cameras look.
#include "models/render/scene_frame.h"

#include <Eigen/Dense>

namespace cloam {
namespace {

/// Least squares of the distances to the optical axes: sum (I - d d^T) (x - o) = 0.
Eigen::Vector3d focus(const Scene& scene) {
  Eigen::Matrix3d normal = 1e-6 * Eigen::Matrix3d::Identity();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Frame& frame : scene.frames) {
    const Eigen::Vector3d direction = frame.world_from_camera.block<3, 1>(0, 2),
                          origin = frame.world_from_camera.block<3, 1>(0, 3);
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    normal += across + 1e-6 * Eigen::Matrix3d::Identity();
    right += across * origin + 1e-6 * origin;
  }
  return normal.ldlt().solve(right);
}

}  // namespace

SceneFrame fit_scene(const Scene& scene) {
  SceneFrame frame;
  if (scene.hints.synthetic_bounds) {
    frame.scale = 1 / 1.5;
    return frame;
  }
  frame.contract = true;
  frame.centre = focus(scene);
  double distance = 0;
  for (const Frame& f : scene.frames) distance += (f.world_from_camera.block<3, 1>(0, 3) - frame.centre).norm();
  distance /= static_cast<double>(std::max<size_t>(1, scene.frames.size()));
  frame.scale = distance > 1e-9 ? 1 / distance : 1;
  return frame;
}

}  // namespace cloam
