// Points to begin with, from whatever a capture has.
#include "models/splat/initial_gaussians.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "models/data/load_sweep.h"
#include "models/gaussians/formats.h"
#include "models/gaussians/initialise.h"
#include "models/gaussians/turn.h"
#include "models/scene/orbit.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

constexpr uint8_t kGrey = 128, kOpaque = 128;
constexpr std::size_t kMaxCameras = 64;  // that are asked whether they see a point
constexpr int kAttempts = 40;
constexpr double kBoxMargin = 0.1;                      // metres
constexpr double kLowestSky = -0.05, kSkyRadius = 1.5;  // sine of the elevation; of the furthest point's distance
constexpr double kGoldenAngle = 2.399963229728653;
constexpr uint32_t kRandomStream = 50;

std::vector<const Frame*> training_frames(const Scene& scene) {
  const std::vector<std::size_t> all = frames_of(scene, Split::train);
  std::vector<const Frame*> some;
  const std::size_t every = (all.size() + kMaxCameras - 1) / kMaxCameras;
  for (std::size_t i = 0; i < all.size(); i += std::max<std::size_t>(1, every)) some.push_back(&scene.frames[all[i]]);
  return some;
}

/// Where a camera shows a point.
std::optional<Eigen::Vector2d> pixel_of(const Camera& camera, const Eigen::Matrix4d& world_from_camera,
                                        const Vector3d& point) {
  const Vector3d at = world_from_camera.block<3, 3>(0, 0).transpose() * (point - world_from_camera.block<3, 1>(0, 3));
  if (at.z() <= 0) return std::nullopt;
  const Eigen::Vector2d pixel = project(camera, at);
  if (pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < camera.width && pixel.y() < camera.height) return pixel;
  return std::nullopt;
}

void add(PointCloud& cloud, const Vector3d& point) {
  for (int k = 0; k < 3; k++) cloud.positions.push_back(static_cast<float>(point[k]));
  cloud.colours.insert(cloud.colours.end(), 3, kGrey);
}

/// Points of a cube around what the cameras look at that at least half as many of them see as see its middle.
PointCloud random_points(const Scene& scene, const InitialOptions& options) {
  const std::vector<const Frame*> cameras = training_frames(scene);
  Vector3d middle = Vector3d::Zero();
  double half = 1.5;
  if (!scene.hints.synthetic_bounds) {
    middle = looked_at(scene);
    half = 0;
    for (const Frame* frame : cameras)
      half += (frame->position() - middle).norm() / static_cast<double>(cameras.size());
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
      add(out, point);
    }
  }
  if (out.count() == 0)
    throw Error(Fault::data, "no point is seen by several cameras: are the poses right? (cloam check DATA)");
  return out;
}

/// The actors that go somewhere in the log.
std::vector<const Actor*> movers(const Scene& scene) {
  std::vector<const Actor*> out;
  for (const Actor& actor : scene.actors)
    if (goes_somewhere(actor)) out.push_back(&actor);
  return out;
}

bool is_in(const Actor& actor, const Vector3d& point, double time) {
  const auto pose = world_from_box_at(actor, time);
  if (!pose) return false;
  const Vector3d at = pose->block<3, 3>(0, 0).transpose() * (point - pose->block<3, 1>(0, 3));
  return (at.cwiseAbs() - actor.size / 2).maxCoeff() < kBoxMargin;
}

/// What training cameras see of a dome (Fibonacci's lattice) around them, from a little below the horizon on.
void add_sky(PointCloud& cloud, const Scene& scene, std::size_t count) {
  const CameraRegion cameras = camera_region(scene);
  const std::vector<const Frame*> frames = training_frames(scene);
  double radius = 0;
  for (std::size_t i = 0; i < cloud.count(); i++)
    radius = std::max(
        radius, (Eigen::Map<const Eigen::Vector3f>(&cloud.positions[3 * i]).cast<double>() - cameras.middle).norm());
  const Eigen::Matrix3d world_from_dome = turn_between(Vector3d::UnitZ(), scene.up.normalized());
  for (std::size_t k = 0; k < count; k++) {
    const double height = kLowestSky + (1 - kLowestSky) * (static_cast<double>(k) + 0.5) / static_cast<double>(count);
    const double across = std::sqrt(1 - height * height), turn = static_cast<double>(k) * kGoldenAngle;
    const Vector3d point =
        cameras.middle +
        kSkyRadius * radius * (world_from_dome * Vector3d(across * std::cos(turn), across * std::sin(turn), height));
    if (std::any_of(frames.begin(), frames.end(), [&](const Frame* f) { return sees(scene, *f, point); }))
      add(cloud, point);
  }
}

PointCloud lidar_points(const Scene& scene, const InitialOptions& options) {
  const std::vector<const Actor*> moving = movers(scene);
  std::vector<Vector3d> still;
  for (const Sweep& sweep : scene.sweeps) {
    if (sweep.split != Split::train) continue;
    const LidarPoints points = load_sweep(scene, sweep);
    for (std::size_t i = 0; i < points.size(); i++) {
      const Vector3d point = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>();
      const double time = sweep.timestamp + double{points.times[i]};
      if (std::none_of(moving.begin(), moving.end(), [&](const Actor* a) { return is_in(*a, point, time); }))
        still.push_back(point);
    }
  }
  const std::size_t kept = std::min(still.size(), static_cast<std::size_t>(options.random));
  PointCloud out;
  for (std::size_t k = 0; k < kept; k++) add(out, still[k * still.size() / kept]);
  if (kept > 0) add_sky(out, scene, kept / 10);
  return out;
}

}  // namespace

Gaussians one_gaussian() { return {{0, 0, 0}, {0, 0, 0}, {1, 0, 0, 0}, {0}, {0, 0, 0}, std::vector<float>(45)}; }

CameraRegion camera_region(const Scene& scene) {
  CameraRegion out;
  const std::vector<std::size_t> frames = frames_of(scene, Split::train);
  for (const std::size_t i : frames) out.middle += scene.frames[i].position() / static_cast<double>(frames.size());
  double farthest = 0;
  for (const std::size_t i : frames) farthest = std::max(farthest, (scene.frames[i].position() - out.middle).norm());
  if (farthest > 1e-6) out.radius = 1.1 * farthest;
  return out;
}

Vector3d mean_of(const Gaussians& gaussians, std::size_t i) {
  return Eigen::Map<const Eigen::Vector3f>(&gaussians.means[3 * i]).cast<double>();
}

bool sees(const Scene& scene, const Frame& frame, const Vector3d& point) {
  return pixel_of(scene.cameras[static_cast<std::size_t>(frame.camera)], frame.world_from_camera, point).has_value();
}

std::optional<std::size_t> pixel_that_shows(const PosedPhoto& photo, const Vector3d& point) {
  const auto pixel = pixel_of(photo.camera, photo.world_from_camera, point);
  if (!pixel) return std::nullopt;
  const FramePixels& seen = photo.pixels;
  const std::size_t at = static_cast<std::size_t>(pixel->y()) * static_cast<std::size_t>(seen.width) +
                         static_cast<std::size_t>(pixel->x());
  const bool is_hidden = seen.rgba[4 * at + 3] < kOpaque || (!seen.mask.empty() && seen.mask[at] == 0);
  return is_hidden ? std::nullopt : std::optional(at);
}

void NearestColour::look(const PosedPhoto& photo, const Vector3d& point, const ActorSpace& actors) {
  const Vector3d eye = photo.world_from_camera.block<3, 1>(0, 3);
  const double distance = (point - eye).norm();
  const auto at = distance < distance_ ? pixel_that_shows(photo, point) : std::nullopt;
  if (!at || actors.stands_between(eye, point)) return;
  distance_ = distance;
  for (std::size_t c = 0; c < 3; c++)
    first_[c] = static_cast<float>((photo.pixels.rgba[4 * *at + c] / 255.0 - 0.5) / kSphericalFirst);
}

void NearestColour::put(Gaussians& gaussians, std::size_t i) const {
  if (found()) std::copy(first_.begin(), first_.end(), &gaussians.sh_first[3 * i]);
}

void colour_unseen(Gaussians& gaussians, std::vector<char>& is_seen, std::size_t first, std::size_t last) {
  Vector3d sum = Vector3d::Zero();
  std::size_t seen = 0;
  for (std::size_t i = first; i < last; i++) {
    if (!is_seen[i]) continue;
    sum += Eigen::Map<const Eigen::Vector3f>(&gaussians.sh_first[3 * i]).cast<double>();
    seen++;
  }
  if (seen == 0) return;
  const Eigen::Vector3f mean = (sum / static_cast<double>(seen)).cast<float>();
  for (std::size_t i = first; i < last; i++)
    if (!is_seen[i]) Eigen::Map<Eigen::Vector3f>(&gaussians.sh_first[3 * i]) = mean;
  std::fill(is_seen.begin() + static_cast<std::ptrdiff_t>(first), is_seen.begin() + static_cast<std::ptrdiff_t>(last),
            char{1});
}

void colour_from(const std::vector<PosedPhoto>& photos, Gaussians& gaussians) {
  std::vector<char> is_seen(gaussians.count());
  for (std::size_t i = 0; i < gaussians.count(); i++) {
    NearestColour nearest;
    for (const PosedPhoto& photo : photos) nearest.look(photo, mean_of(gaussians, i));
    nearest.put(gaussians, i);
    is_seen[i] = nearest.found();
  }
  colour_unseen(gaussians, is_seen, 0, gaussians.count());
}

PointCloud points_from_depths(const std::vector<PosedPhoto>& photos, int most) {
  const auto for_each_known = [&](const auto& use) {
    for (const PosedPhoto& photo : photos)
      for (std::size_t at = 0; at < photo.pixels.depth.size(); ++at)
        if (photo.pixels.depth[at] > 0) use(photo, at);
  };
  std::size_t all = 0, number = 0;
  for_each_known([&](const PosedPhoto&, std::size_t) { ++all; });
  if (all == 0)
    bad_data("no pixel of the depth maps has a depth; are they of this capture?\n  fix: --set initial=random");
  const std::size_t kept = std::min(all, static_cast<std::size_t>(most));
  PointCloud out;
  for_each_known([&](const PosedPhoto& photo, std::size_t at) {
    const std::size_t place = number++;
    if (place * kept / all == (place + 1) * kept / all) return;
    const auto width = static_cast<std::size_t>(photo.pixels.width);
    const Eigen::Vector2d middle(static_cast<double>(at % width) + 0.5, static_cast<double>(at / width) + 0.5);
    const Vector3d towards = direction(photo.camera, middle);
    const Vector3d point =
        (photo.world_from_camera * (towards * (double{photo.pixels.depth[at]} / towards.z())).homogeneous()).head<3>();
    for (int k = 0; k < 3; k++) {
      out.positions.push_back(static_cast<float>(point[k]));
      out.colours.push_back(photo.pixels.rgba[4 * at + static_cast<std::size_t>(k)]);
    }
  });
  return out;
}

InitialGaussians initial_gaussians(const Scene& scene, const InitialOptions& options) {
  if (std::filesystem::path(options.kind).has_extension()) return {read_gaussians(options.kind).gaussians, false};
  const bool automatic = options.kind == "auto";
  const bool points = options.kind == "points" || (automatic && scene.cloud.count() > 0);
  const bool lidar = options.kind == "lidar" || (automatic && !points && !scene.sweeps.empty());
  const bool has_depths = options.depths && std::any_of(scene.frames.begin(), scene.frames.end(), [](const Frame& f) {
                            return f.depth && f.split == Split::train;
                          });
  const bool depths = options.kind == "depths" || (automatic && !points && !lidar && has_depths);
  if (!automatic && !points && !lidar && !depths && options.kind != "random")
    throw Error(Fault::usage,
                text("setting initial: \"", options.kind, "\", want auto, points, lidar, depths, random or a file"));
  if (depths && !has_depths)
    throw Error(Fault::data, "initial=depths: the capture has no depth maps\n  fix: --set initial=random");
  if (depths) return {one_gaussian(), false, true};
  const PointCloud cloud = points ? scene.cloud : lidar ? lidar_points(scene, options) : random_points(scene, options);
  if (cloud.count() == 0)
    throw Error(Fault::data, text("initial=", options.kind, ": the capture has no ", points ? "points" : "LiDAR sweeps",
                                  "\n  fix: --set initial=random"));
  return {gaussians_from_points(cloud), !points};
}

}  // namespace cloam
