// Points to begin with, from whatever a capture has.
#include "models/splat/initial_gaussians.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "models/data/load_sweep.h"
#include "models/scene/orbit.h"
#include "models/splat/files/formats.h"
#include "models/splat/initialise.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

constexpr uint8_t kGrey = 128;
constexpr std::size_t kMostCameras = 64;  // that are asked whether they see a point
constexpr int kAttempts = 40;
enum Stream : uint32_t { kRandomStream = 50, kLidarStream = 51 };

Vector3d position(const Frame& frame) { return frame.world_from_camera.block<3, 1>(0, 3); }

std::vector<const Frame*> training_frames(const Scene& scene) {
  const std::vector<std::size_t> all = frames_of(scene, Split::train);
  std::vector<const Frame*> some;
  const std::size_t every = (all.size() + kMostCameras - 1) / kMostCameras;
  for (std::size_t i = 0; i < all.size(); i += std::max<std::size_t>(1, every)) some.push_back(&scene.frames[all[i]]);
  return some;
}

bool sees(const Scene& scene, const Frame& frame, const Vector3d& point) {
  const Vector3d at = frame.world_from_camera.block<3, 3>(0, 0).transpose() * (point - position(frame));
  if (at.z() <= 0) return false;
  const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
  const Eigen::Vector2d pixel = project(camera, at);
  return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < camera.width && pixel.y() < camera.height;
}

/// Points of a cube around what the cameras look at that at least half as many of them see as see its middle.
PointCloud random_points(const Scene& scene, const InitialOptions& options) {
  const std::vector<const Frame*> cameras = training_frames(scene);
  Vector3d middle = Vector3d::Zero();
  double half = 1.5;
  if (!scene.hints.synthetic_bounds) {
    middle = looked_at(scene);
    half = 0;
    for (const Frame* frame : cameras) half += (position(*frame) - middle).norm() / static_cast<double>(cameras.size());
  }
  const auto seen_by = [&](const Vector3d& point) {
    return std::count_if(cameras.begin(), cameras.end(), [&](const Frame* f) { return sees(scene, *f, point); });
  };
  const auto wanted = std::max<std::ptrdiff_t>(1, seen_by(middle) / 2);
  PointCloud out;
  for (uint32_t attempt = 0; attempt < kAttempts && out.count() < static_cast<std::size_t>(options.random); attempt++) {
    const std::vector<float> u = random_uniform({options.random, 3}, {options.seed, attempt, kRandomStream}).to_host();
    for (std::size_t i = 0; i + 3 <= u.size() && out.count() < static_cast<std::size_t>(options.random); i += 3) {
      const Vector3d point =
          middle + half * Vector3d(2 * double{u[i]} - 1, 2 * double{u[i + 1]} - 1, 2 * double{u[i + 2]} - 1);
      if (seen_by(point) < wanted) continue;
      for (int k = 0; k < 3; k++) out.positions.push_back(static_cast<float>(point[k]));
      out.colours.insert(out.colours.end(), 3, kGrey);
    }
  }
  if (out.count() == 0)
    throw Error(Fault::data, "no point is seen by several cameras: are the poses right? (cloam check DATA)");
  return out;
}

PointCloud lidar_points(const Scene& scene, const InitialOptions& options) {
  std::vector<float> all;
  for (const Sweep& sweep : scene.sweeps) {
    if (sweep.split != Split::train) continue;
    const LidarPoints points = load_sweep(scene, sweep);
    all.insert(all.end(), points.positions.begin(), points.positions.end());
  }
  const std::size_t count = all.size() / 3, kept = std::min(count, static_cast<std::size_t>(options.random));
  PointCloud out;
  const double step = kept > 0 ? static_cast<double>(count) / static_cast<double>(kept) : 1;
  for (std::size_t k = 0; k < kept; k++) {
    const auto from =
        all.begin() + static_cast<std::ptrdiff_t>(3 * static_cast<std::size_t>(static_cast<double>(k) * step));
    out.positions.insert(out.positions.end(), from, from + 3);
    out.colours.insert(out.colours.end(), 3, kGrey);
  }
  return out;
}

}  // namespace

double camera_radius(const Scene& scene) {
  Vector3d middle = Vector3d::Zero();
  const std::vector<std::size_t> frames = frames_of(scene, Split::train);
  for (const std::size_t i : frames) middle += position(scene.frames[i]) / static_cast<double>(frames.size());
  double radius = 0;
  for (const std::size_t i : frames) radius = std::max(radius, (position(scene.frames[i]) - middle).norm());
  return radius > 1e-6 ? 1.1 * radius : 1;
}

Gaussians initial_gaussians(const Scene& scene, const InitialOptions& options) {
  if (std::filesystem::path(options.kind).has_extension()) return read_gaussians(options.kind).gaussians;
  const bool automatic = options.kind == "auto";
  const bool points = options.kind == "points" || (automatic && scene.cloud.count() > 0);
  const bool lidar = options.kind == "lidar" || (automatic && !points && !scene.sweeps.empty());
  if (!automatic && !points && !lidar && options.kind != "random")
    throw Error(Fault::usage,
                text("setting initial: \"", options.kind, "\", want auto, points, lidar, random or a file"));
  const PointCloud cloud = points ? scene.cloud : lidar ? lidar_points(scene, options) : random_points(scene, options);
  if (cloud.count() == 0)
    throw Error(Fault::data, text("initial=", options.kind, ": the capture has no ", points ? "points" : "LiDAR sweeps",
                                  "\n  fix: --set initial=random"));
  return gaussians_from_points(cloud);
}

}  // namespace cloam
