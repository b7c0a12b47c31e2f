// See initial_street.h.
#include "models/splat/initial_street.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "models/gaussians/initialise.h"
#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/host_random.h"
#include "models/io/in_parallel.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

constexpr double kInBox = 0.05;       // metres of the boxes' sides that still count as inside
constexpr double kLowest = -0.05;     // sine of the elevation of what is drawn: LiDAR sees what is below
constexpr double kFarthest = 30;      // times as far as LiDAR sees
constexpr int64_t kDrawsAPoint = 20;  // for each point that is wanted
constexpr double kLargest = 0.15;     // deviation of an actor's gaussian, of its box's smallest side
constexpr uint64_t kNearStream = 1, kFarStream = 2, kActorStream = 3;

void add_grey(PointCloud& cloud, const Vector3d& point) {
  for (int k = 0; k < 3; k++) cloud.positions.push_back(static_cast<float>(point[k]));
  cloud.colours.insert(cloud.colours.end(), 3, 128);
}

/// At most so many, evenly.
std::vector<Vector3d> thinned(const std::vector<Vector3d>& points, std::size_t most) {
  const std::size_t kept = std::min(points.size(), most);
  std::vector<Vector3d> out;
  for (std::size_t k = 0; k < kept; ++k) out.push_back(points[k * points.size() / kept]);
  return out;
}

/// Takes one point of each voxel, the first.
class VoxelFilter {
 public:
  explicit VoxelFilter(double side) : side_(side) {}
  bool takes(const Vector3d& point) {
    uint64_t key = 0;
    for (int k = 0; k < 3; ++k)
      key = key << 21 | (static_cast<uint64_t>(static_cast<int64_t>(std::floor(point[k] / side_))) & 0x1fffff);
    return seen_.insert(key).second;
  }

 private:
  double side_;
  std::set<uint64_t> seen_;
};

/// What LiDAR saw, of the background in the world, of each actor in its box.
struct SeenPoints {
  std::vector<Vector3d> background;
  std::vector<std::vector<Vector3d>> actors;
};

/// The actors that are there at a time.
class Present {
 public:
  Present(const Scene& scene, double time) {
    for (std::size_t a = 0; a < scene.actors.size(); ++a)
      if (const auto pose = world_from_box_at(scene.actors[a], time))
        boxes_.push_back({a, pose->inverse(), scene.actors[a].size / 2});
  }
  /// Adds the point to the actor in whose box it lies.
  bool take(const Vector3d& point, SeenPoints& seen) const {
    for (const Box& box : boxes_) {
      const Vector3d at = (box.box_from_world * point.homogeneous()).head<3>();
      if ((at.cwiseAbs() - box.half).maxCoeff() > kInBox) continue;
      seen.actors[box.actor].push_back(at);
      return true;
    }
    return false;
  }

 private:
  struct Box {
    std::size_t actor;
    Eigen::Matrix4d box_from_world;
    Vector3d half;
  };
  std::vector<Box> boxes_;
};

SeenPoints seen_points(const Scene& scene, const EverySweep& every_sweep, double voxel) {
  SeenPoints seen;
  seen.actors.resize(scene.actors.size());
  VoxelFilter filter(voxel);
  every_sweep([&](const Sweep& sweep, const LidarPoints& points) {
    std::map<double, Present> moments;
    ActorSpaces spaces(scene);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vector3d point = Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>();
      const double time = seen_from(sweep, points, i).time;
      if (!spaces.at(time).holds(point)) {
        if (filter.takes(point)) seen.background.push_back(point);
        continue;
      }
      auto found = moments.find(time);
      if (found == moments.end()) found = moments.emplace(time, Present(scene, time)).first;
      found->second.take(point, seen);  // what lies between the box and its room is ground, or nothing
    }
  });
  return seen;
}

/// Directions in which a training camera looks, from a little below the horizon on.
class Skyward {
 public:
  explicit Skyward(const Scene& scene) : scene_(scene), region_(camera_region(scene)) {
    const std::vector<std::size_t> all = frames_of(scene, Split::train);
    const std::size_t every = std::max<std::size_t>(1, all.size() / kCameras);
    for (std::size_t i = 0; i < all.size(); i += every) frames_.push_back(&scene.frames[all[i]]);
    world_from_dome_ = turn_between(Vector3d::UnitZ(), scene.up.normalized());
  }
  const Vector3d& middle() const { return region_.middle; }

  /// `count` points at distances that `distance_of` makes of a number in [0,1).
  template <class Distance>
  void draw(PointCloud& cloud, int count, HostRandom random, const Distance& distance_of) const {
    int found = 0;
    for (int64_t attempt = 0; attempt < kDrawsAPoint * count && found < count; ++attempt) {
      const double height = random.between(kLowest, 1), turn = random.between(0, 2 * M_PI),
                   across = std::sqrt(1 - height * height);
      const Vector3d point =
          region_.middle + distance_of(random.between(0, 1)) *
                               (world_from_dome_ * Vector3d(across * std::cos(turn), across * std::sin(turn), height));
      if (std::none_of(frames_.begin(), frames_.end(), [&](const Frame* f) { return sees(scene_, *f, point); }))
        continue;
      add_grey(cloud, point);
      ++found;
    }
  }

 private:
  static constexpr std::size_t kCameras = 64;
  const Scene& scene_;
  CameraRegion region_;
  std::vector<const Frame*> frames_;
  Eigen::Matrix3d world_from_dome_;
};

Gaussians background_of(const Scene& scene, const std::vector<Vector3d>& seen, const StreetStartOptions& options) {
  PointCloud cloud;
  const Skyward skyward(scene);
  double reach = 10;
  for (const Vector3d& point : thinned(seen, static_cast<std::size_t>(options.lidar))) {
    add_grey(cloud, point);
    reach = std::max(reach, (point - skyward.middle()).norm());
  }
  skyward.draw(cloud, options.near, {options.seed, kNearStream}, [&](double u) { return reach * std::cbrt(u); });
  // As many within each factor of the distance.
  skyward.draw(cloud, options.far, {options.seed, kFarStream},
               [&](double u) { return reach * std::pow(kFarthest, u); });
  if (cloud.count() == 0)
    throw Error(Fault::data,
                "the log gives no point to begin with: it has no LiDAR returns outside of boxes, and no camera looks "
                "up\n  fix: a log with sweeps, or train splat with initial=random");
  return gaussians_from_points(cloud);
}

Gaussians actor_gaussians(const Actor& actor, std::vector<Vector3d> seen, HostRandom random,
                          const StreetStartOptions& options) {
  PointCloud cloud;
  seen = thinned(seen, static_cast<std::size_t>(options.actor));
  for (const Vector3d& point : seen) add_grey(cloud, point);
  for (int count = static_cast<int>(seen.size()); count < options.fewest; ++count) {
    Vector3d share;
    for (int k = 0; k < 3; ++k) share[k] = random.between(-0.5, 0.5);
    add_grey(cloud, actor.size.cwiseProduct(share));
  }
  if (cloud.count() == 0) return {};
  Gaussians out = gaussians_from_points(cloud);
  const float most = static_cast<float>(std::log(kLargest * std::max(0.1, actor.size.minCoeff())));
  for (float& scale : out.scales) scale = std::min(scale, most);
  return out;
}

/// What lies in a box at a photo's time, such as the road below wheels, is hidden as well.
void colour_background(const StreetPhotos& photos, Gaussians& background) {
  std::vector<char> is_seen(background.count());
  in_parallel(background.count(), [&](std::size_t i) {
    const Vector3d mean = mean_of(background, i);
    NearestColour nearest;
    for (const auto& [photo, actors] : photos.all())
      if (!actors.holds(mean)) nearest.look(photo.photo, mean, actors);
    nearest.put(background, i);
    is_seen[i] = nearest.found();
  });
  colour_unseen(background, is_seen, 0, background.count());
}

void colour_actors(const StreetPhotos& photos, const Scene& scene, StreetStart& start) {
  std::vector<std::size_t> firsts;  // of each actor that has any
  for (std::size_t i = 0; i < start.owners.size(); ++i)
    if (i == 0 || start.owners[i] != start.owners[i - 1]) firsts.push_back(i);
  firsts.push_back(start.owners.size());
  std::vector<char> is_seen(start.owners.size());
  in_parallel(firsts.size() - 1, [&](std::size_t part) {
    const Actor& actor = scene.actors[static_cast<std::size_t>(start.owners[firsts[part]])];
    std::vector<std::pair<StreetPhotos::One, Eigen::Matrix4d>> there;
    for (const StreetPhotos::One& one : photos.all())
      if (const auto pose = world_from_box_at(actor, one.photo.time)) there.emplace_back(one, *pose);
    for (std::size_t i = firsts[part]; i < firsts[part + 1]; ++i) {
      const Vector3d mean = mean_of(start.actors, i);
      NearestColour nearest;
      for (const auto& [one, pose] : there)
        nearest.look(one.photo.photo, (pose * mean.homogeneous()).head<3>(), one.actors);
      nearest.put(start.actors, i);
      is_seen[i] = nearest.found();
    }
  });
  for (std::size_t part = 0; part + 1 < firsts.size(); ++part)
    colour_unseen(start.actors, is_seen, firsts[part], firsts[part + 1]);
  colour_unseen(start.actors, is_seen, 0, is_seen.size());
}

/// How many points each actor may keep, so that all have no more than `actors` together, if `fewest` of each allow it.
int most_of_each(const SeenPoints& seen, const Scene& scene, const StreetStartOptions& options) {
  const auto together = [&](int most) {
    int64_t sum = 0;
    for (std::size_t a = 0; a < scene.actors.size(); ++a)
      if (!scene.actors[a].boxes.empty())
        sum += std::max<int64_t>(options.fewest, std::min<int64_t>(most, static_cast<int64_t>(seen.actors[a].size())));
    return sum;
  };
  int least = std::min(options.fewest, options.actor), most = options.actor;
  while (least < most) {
    const int middle = least + (most - least + 1) / 2;
    if (together(middle) <= options.actors)
      least = middle;
    else
      most = middle - 1;
  }
  return least;
}

}  // namespace

StreetStart street_start(const Scene& scene, const EverySweep& every_sweep, StreetStartOptions options) {
  const SeenPoints seen = seen_points(scene, every_sweep, double{options.voxel});
  options.actor = most_of_each(seen, scene, options);
  StreetStart start;
  start.background = background_of(scene, seen.background, options);
  start.seen = std::min(seen.background.size(), static_cast<std::size_t>(options.lidar));
  for (std::size_t a = 0; a < scene.actors.size(); ++a) {
    if (scene.actors[a].boxes.empty()) continue;
    const HostRandom random(options.seed, mixed(kActorStream) + a);
    const Gaussians own = actor_gaussians(scene.actors[a], seen.actors[a], random, options);
    append(start.actors, own);
    start.owners.insert(start.owners.end(), own.count(), static_cast<int32_t>(a));
  }
  return start;
}

void colour_street(const std::vector<TimedPhoto>& photos, const Scene& scene, StreetStart& start) {
  const StreetPhotos with_actors(photos, scene);
  colour_background(with_actors, start.background);
  colour_actors(with_actors, scene, start);
}

}  // namespace cloam
