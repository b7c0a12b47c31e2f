// See photo_hints.h.
#include "models/street/photo_hints.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "models/data/actor_masks.h"
#include "models/io/in_parallel.h"
#include "models/scene/actor_space.h"
#include "models/street/street_boxes.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kLeast = 0.5;         // metres before a camera
constexpr float kBehind = 1.1f;        // times as far as a return beside it
constexpr float kBehindMetres = 0.5f;  // and so much further
constexpr double kRoom = 0.2;          // metres around boxes
constexpr int kCellsAcross = 160;      // of a photo: rays that ask for the sky
constexpr int64_t kRaysAsked = 1 << 14;

Vector3d move(const Matrix4d& pose, const Vector3d& p) { return (pose * p.homogeneous()).head<3>(); }

int cell_of(const Camera& camera) { return std::max(1, camera.width / kCellsAcross); }

/// Takes points on actors from one time to another.
class WithActors {
 public:
  WithActors(const Scene& scene, double to) : scene_(scene), to_(to), spaces_(scene) {}

  /// None: the actor is not there then.
  std::optional<Vector3d> moved(const Vector3d& point, double from) {
    if (!spaces_.at(from).holds(point)) return point;
    for (const Ride& ride : rides_at(from)) {
      const Vector3d at = move(ride.box_from_world, point);
      if ((at.cwiseAbs() - ride.half).maxCoeff() > kRoom) continue;
      return ride.world_from_box ? std::optional(move(*ride.world_from_box, at)) : std::nullopt;
    }
    return point;
  }

 private:
  struct Ride {
    Matrix4d box_from_world;
    Vector3d half;
    std::optional<Matrix4d> world_from_box;  // at the other time
  };
  const std::vector<Ride>& rides_at(double time) {
    const auto [found, fresh] = rides_.try_emplace(time);
    if (fresh)
      for (const Actor& actor : scene_.actors)
        if (const auto pose = world_from_box_at(actor, time))
          found->second.push_back({pose->inverse(), actor.size / 2, world_from_box_at(actor, to_)});
    return found->second;
  }

  const Scene& scene_;
  double to_;
  ActorSpaces spaces_;
  std::map<double, std::vector<Ride>> rides_;
};

/// The nearest depth at each pixel, and whether one beside it is much nearer: to the sides, where a thing's outline
/// is, rather than below, where the ground comes nearer from row to row.
class Nearest {
 public:
  explicit Nearest(const Camera& camera)
      : width_(camera.width), height_(camera.height), across_(cell_of(camera)), down_(across_ / 4) {
    depths_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
                   std::numeric_limits<float>::infinity());
  }
  void add(int32_t pixel, float depth) {
    float& nearest = depths_[static_cast<std::size_t>(pixel)];
    nearest = std::min(nearest, depth);
  }
  bool hides(int32_t pixel, float depth) const {
    const int x = pixel % width_, y = pixel / width_;
    for (int row = std::max(0, y - down_); row <= std::min(height_ - 1, y + down_); ++row)
      for (int column = std::max(0, x - across_); column <= std::min(width_ - 1, x + across_); ++column) {
        const float beside = depths_[static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
                                     static_cast<std::size_t>(column)];
        if (depth > kBehind * beside && depth > beside + kBehindMetres) return true;
      }
    return false;
  }

 private:
  int width_, height_, across_, down_;
  std::vector<float> depths_;
};

/// Sets a bit of all pixels of a cell.
void mark(std::vector<uint8_t>& kinds, const Camera& camera, int cell, int64_t column, int64_t row, PixelKind kind) {
  for (int64_t y = row * cell; y < std::min<int64_t>(camera.height, (row + 1) * cell); ++y)
    for (int64_t x = column * cell; x < std::min<int64_t>(camera.width, (column + 1) * cell); ++x)
      kinds[static_cast<std::size_t>(y * camera.width + x)] |= kind;
}

/// Of each cell, whether its ray meets nothing.
std::vector<bool> open_cells(const Scene& scene, const StreetSpace& space, const Frame& frame, const Camera& camera,
                             int cell) {
  RayList all;
  const Region region = cells_of(camera, cell);
  add_cells(all, {camera, space.street_from_world() * frame.world_from_camera, frame.timestamp.value_or(0)}, region,
            cell);
  std::vector<bool> open;
  for (int64_t begin = 0; begin < all.count(); begin += kRaysAsked) {
    const RayList part = part_of(all, begin, std::min(all.count(), begin + kRaysAsked));
    const int64_t count = part.count();
    const StreetRays rays = {from_host(part.origins, {count, 3}), from_host(part.directions, {count, 3}),
                             zeros({count, 2}), from_host(part.moments, {count})};
    const StreetSteps steps = {0.9f * space.options().voxel, 0.5f, 0, false};
    const std::vector<int32_t> offsets =
        street_samples(rays, boxes_of(scene.actors, part, space), space.grid(), steps).offsets.to_host<int32_t>();
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) open.push_back(offsets[i + 1] == offsets[i]);
  }
  return open;
}

}  // namespace

PixelDepths pixel_depths(const Scene& scene, const Frame& frame, const Camera& camera, const Sweep& sweep,
                         const LidarPoints& points) {
  PixelDepths all, out;
  Nearest nearest(camera);
  WithActors actors(scene, frame.timestamp.value_or(sweep.timestamp));
  const Matrix4d camera_from_world = frame.world_from_camera.inverse();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector3d recorded = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>();
    if (move(camera_from_world, recorded).z() < kLeast) continue;
    const auto then = actors.moved(recorded, seen_from(sweep, points, i).time);
    if (!then) continue;
    const Vector3d at = move(camera_from_world, *then);
    if (at.z() < kLeast) continue;
    const Eigen::Vector2d pixel = project(camera, at);
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= camera.width || pixel.y() >= camera.height) continue;
    all.pixels.push_back(static_cast<int32_t>(pixel.y()) * camera.width + static_cast<int32_t>(pixel.x()));
    all.depths.push_back(static_cast<float>(at.z()));
    nearest.add(all.pixels.back(), all.depths.back());
  }
  for (std::size_t i = 0; i < all.pixels.size(); ++i) {
    if (nearest.hides(all.pixels[i], all.depths[i])) continue;
    out.pixels.push_back(all.pixels[i]);
    out.depths.push_back(all.depths[i]);
  }
  return out;
}

std::vector<uint8_t> pixel_kinds(const Scene& scene, const Frame& frame, const Camera& camera, const StreetSpace& space,
                                 const PixelDepths& depths) {
  std::vector<uint8_t> kinds(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 0);
  const int cell = cell_of(camera);
  const int64_t columns = cells_of(camera, cell).columns;
  const std::vector<bool> open = open_cells(scene, space, frame, camera, cell);
  for (std::size_t i = 0; i < open.size() && !scene.sweeps.empty(); ++i)
    if (open[i])
      mark(kinds, camera, cell, static_cast<int64_t>(i) % columns, static_cast<int64_t>(i) / columns, kSkyPixel);
  for (const int32_t pixel : depths.pixels)
    mark(kinds, camera, cell, pixel % camera.width / cell, pixel / camera.width / cell, kMatterPixel);
  std::vector<PlacedBox> boxes;
  for (std::size_t a = 0; a < scene.actors.size(); ++a)
    if (const auto pose = world_from_box_at(scene.actors[a], frame.timestamp.value_or(0)))
      boxes.push_back({static_cast<int>(a) + 1, scene.actors[a].size + Vector3d::Constant(2 * kRoom), *pose});
  const Camera coarse = scaled(camera, cell);
  const ActorMask mask = outlines(boxes, coarse, frame.world_from_camera);
  for (int row = 0; row < coarse.height; ++row)
    for (int column = 0; column < coarse.width; ++column)
      if (mask.actors[static_cast<std::size_t>(row) * static_cast<std::size_t>(coarse.width) +
                      static_cast<std::size_t>(column)] > 0)
        mark(kinds, camera, cell, column, row, kActorPixel);
  for (uint8_t& kind : kinds)
    if (kind & (kMatterPixel | kActorPixel)) kind &= static_cast<uint8_t>(~kSkyPixel);
  return kinds;
}

BoxesInPhoto::BoxesInPhoto(const Camera& camera, const Matrix4d& world_from_camera, const std::vector<uint8_t>& kinds)
    : camera_(camera),
      camera_from_world_(world_from_camera.inverse()),
      cell_(cell_of(camera)),
      columns_((camera.width + cell_ - 1) / cell_) {
  for (int y = 0; y < camera.height; y += cell_)
    for (int x = 0; x < camera.width; x += cell_)
      there_.push_back(
          (kinds[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(x)] &
           kActorPixel) != 0);
}

std::optional<bool> BoxesInPhoto::covers(const Vector3d& point) const {
  const Vector3d at = move(camera_from_world_, point);
  if (at.z() < kLeast) return std::nullopt;
  const Eigen::Vector2d pixel = project(camera_, at);
  if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= camera_.width || pixel.y() >= camera_.height) return std::nullopt;
  const int column = static_cast<int>(pixel.x()) / cell_, row = static_cast<int>(pixel.y()) / cell_;
  return there_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column)];
}

std::vector<bool> only_in_boxes(const std::vector<float>& points, const std::vector<BoxesInPhoto>& photos) {
  constexpr std::size_t kAtOnce = 1024;
  const std::size_t count = points.size() / 3;
  std::vector<uint8_t> found(count, 0);
  in_parallel((count + kAtOnce - 1) / kAtOnce, [&](std::size_t part) {
    for (std::size_t i = part * kAtOnce; i < std::min(count, (part + 1) * kAtOnce); ++i) {
      const Vector3d point = Eigen::Map<const Eigen::Vector3f>(&points[3 * i]).cast<double>();
      for (const BoxesInPhoto& photo : photos) {
        const std::optional<bool> covered = photo.covers(point);
        if (!covered) continue;
        found[i] = *covered;
        if (!*covered) break;
      }
    }
  });
  return {found.begin(), found.end()};
}

}  // namespace cloam
