// Where cameras look.
#include "models/render/scene_frame.h"

#include <Eigen/Dense>
#include <array>

#include "runtime/error.h"

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

constexpr double kViewingDistancesOfPath = 4;  // places on a line are a quarter of it from its middle, in the mean
constexpr double kNearPlane = 0.75;            // of the distance of the nearest thing (LLFF)
constexpr double kLeastForward = 0.2;          // cosine of the angle between the mean axis and what a corner sees

/// Of the mean camera: its axes by rows.
Eigen::Matrix3d mean_axes(const Scene& scene) {
  Eigen::Vector3d down = Eigen::Vector3d::Zero(), forward = Eigen::Vector3d::Zero();
  for (const Frame& frame : scene.frames) {
    down += frame.world_from_camera.block<3, 1>(0, 1);
    forward += frame.world_from_camera.block<3, 1>(0, 2);
  }
  Eigen::Matrix3d axes;
  axes.row(2) = forward.normalized();
  axes.row(0) = down.cross(forward).normalized();
  axes.row(1) = axes.row(2).cross(axes.row(0));
  return axes;
}

/// What the corners of an image see, in the frame's axes, of length 1.
std::array<Eigen::Vector3d, 4> corners(const Scene& scene, const Frame& f, const Eigen::Matrix3d& turn) {
  const Camera& camera = scene.cameras[static_cast<size_t>(f.camera)];
  std::array<Eigen::Vector3d, 4> seen;
  for (size_t i = 0; i < 4; i++) {
    const Eigen::Vector2d corner(i % 2 == 0 ? 0 : camera.width, i < 2 ? 0 : camera.height);
    seen[i] = turn * f.world_from_camera.topLeftCorner<3, 3>() * direction(camera, corner).normalized();
  }
  return seen;
}

/// The first that sees what lies too far to the side of the mean camera's axis; none: all look one way.
const Frame* first_aside(const Scene& scene) {
  const Eigen::Matrix3d turn = mean_axes(scene);
  for (const Frame& f : scene.frames)
    for (const Eigen::Vector3d& way : corners(scene, f, turn))
      if (!(way.z() > kLeastForward)) return &f;
  return nullptr;
}

}  // namespace

double viewing_distance(const Scene& scene) {
  const Eigen::Vector3d centre = focus(scene);
  double distance = 0;
  for (const Frame& f : scene.frames) distance += (f.world_from_camera.block<3, 1>(0, 3) - centre).norm();
  distance /= static_cast<double>(std::max<size_t>(1, scene.frames.size()));
  return distance > 1e-9 ? distance : 1;
}

bool fits_ndc(const Scene& scene) { return scene.hints.nearest.value_or(0) > 0 && !first_aside(scene); }

SceneFrame fit_ndc(const Scene& scene, double nearest) {
  if (nearest == 0) nearest = scene.hints.nearest.value_or(0);
  if (!(nearest > 0))
    throw Error(Fault::usage,
                "setting space.kind: ndc needs to know how far the nearest thing is, which this capture does not say: "
                "--set space.nearest=DISTANCE, in units of its poses");
  if (const Frame* aside = first_aside(scene))
    throw Error(Fault::usage, text("setting space.kind: ndc is for photos that all look one way; ", aside->name,
                                   " looks too far to the side of the others: use contract"));
  SceneFrame frame;
  frame.ndc = true;
  frame.turn = mean_axes(scene);
  for (const Frame& f : scene.frames) frame.centre += f.position() / static_cast<double>(scene.frames.size());
  double plane = kNearPlane * nearest;
  for (const Frame& f : scene.frames) plane = std::max(plane, 1.01 * (frame.turn * (f.position() - frame.centre)).z());
  frame.scale = 1 / plane;
  Eigen::Vector2d widest(1e-6, 1e-6);
  for (const Frame& f : scene.frames) {
    const Eigen::Vector3d origin = frame.turn * (f.position() - frame.centre) * frame.scale;
    for (const Eigen::Vector3d& way : corners(scene, f, frame.turn)) {
      const Eigen::Vector2d slope = way.head<2>() / way.z(), begin = origin.head<2>() + slope * (1 - origin.z());
      widest = widest.cwiseMax(slope.cwiseAbs()).cwiseMax(begin.cwiseAbs());
    }
  }
  frame.widen = widest.cwiseInverse();
  return frame;
}

Eigen::AlignedBox3d box_of(const SceneFrame& frame) {
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(1 / frame.scale);
  return {frame.centre - half, frame.centre + half};
}

SceneFrame fit_scene(const Scene& scene) {
  SceneFrame frame;
  if (scene.hints.synthetic_bounds) {
    frame.scale = 1 / 1.5;
    return frame;
  }
  frame.contract = true;
  frame.centre = focus(scene);
  frame.scale = 1 / viewing_distance(scene);
  return frame;
}

SceneFrame fit_path(const Scene& scene) {
  SceneFrame frame = fit_scene(scene);
  if (scene.is_log) frame.scale /= kViewingDistancesOfPath;
  return frame;
}

}  // namespace cloam
