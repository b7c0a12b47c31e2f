// See street_sensors.h.
#include "models/synth/street_sensors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "models/io/in_parallel.h"
#include "models/synth/procedural.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180;
constexpr double kTurnTime = 0.1;  // of the LiDAR
constexpr double kReach = 120;     // metres
constexpr double kNoise = 0.02;    // metres
constexpr std::array<Mount, 6> kMounts{{{"front_camera", 0, 328.333333 / 320},
                                        {"front_left_camera", 55 * kDegree, 155.0 / 320},
                                        {"front_right_camera", -55 * kDegree, 155.0 / 320},
                                        {"left_camera", 110 * kDegree, 155.0 / 320},
                                        {"right_camera", -110 * kDegree, 155.0 / 320},
                                        {"back_camera", M_PI, 155.0 / 320}}};

Ray pixel_ray(const Camera& camera, const Matrix4d& world_from_camera, double x, double y) {
  const Vector3d seen((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
  return {world_from_camera.topRightCorner<3, 1>(), (world_from_camera.topLeftCorner<3, 3>() * seen).normalized()};
}

class Row {
 public:
  Row(const StreetMoment& moment, const Camera& camera, const Matrix4d& world_from_camera, int y)
      : moment_(moment), camera_(camera), pose_(world_from_camera), y_(y) {}

  void draw(StreetPicture& picture) const {
    for (int x = 0; x < camera_.width; ++x) {
      const std::size_t pixel = std::size_t(y_) * camera_.width + x;
      const Vector3d colour = colour_of(x);
      for (int c = 0; c < 3; ++c) {
        picture.image.pixels[3 * pixel + std::size_t(c)] = static_cast<std::uint8_t>(std::lround(255 * colour[c]));
      }
      const Ray ray = pixel_ray(camera_, pose_, x + 0.5, y_ + 0.5);
      if (const auto seen = moment_.nearest(ray, across())) {
        picture.actor[pixel] = static_cast<std::uint8_t>(seen->actor);
        picture.depth[pixel] = static_cast<float>(seen->distance * ray.direction.dot(pose_.block<3, 1>(0, 2)));
      }
    }
  }

 private:
  double across() const { return 0.5 / camera_.fx; }

  /// The mean of the encoded samples.
  Vector3d colour_of(int x) const {
    Vector3d sum = Vector3d::Zero();
    for (int sample = 0; sample < 4; ++sample) {
      const Ray ray = pixel_ray(camera_, pose_, x + 0.25 + 0.5 * (sample % 2), y_ + 0.25 + 0.5 * (sample / 2));
      sum += 0.25 * moment_.colour(ray, across()).unaryExpr(&srgb);
    }
    return sum;
  }

  const StreetMoment& moment_;
  const Camera& camera_;
  const Matrix4d& pose_;
  int y_;
};

double normal_number(HostRandom& random) {
  const double radius = std::sqrt(-2 * std::log(1 - random.between(0, 1)));  // Box and Muller 1958
  return radius * std::cos(2 * M_PI * random.between(0, 1));
}

struct Return {
  Vector3d point;
  double intensity = 0;
};

/// Dark, slanted and far surfaces send too little back; glass lets most of the light through.
std::optional<Return> lidar_return(const StreetMoment& moment, const Ray& ray, HostRandom& random) {
  const double chance = random.between(0, 1), noise = kNoise * normal_number(random);
  const auto seen = moment.nearest(ray, 0.002);
  if (!seen || seen->distance > kReach) return std::nullopt;
  const double facing = std::abs(ray.direction.dot(seen->normal));
  const double grey = seen->surface.albedo.mean();
  const double intensity = std::min(1.0, std::pow(grey, 0.8) * (0.4 + 0.6 * facing) * (1 + 2 * noise));
  const double strength = intensity * (0.3 + 0.7 * facing) * std::pow(80 / seen->distance, 2);
  const double kept = (1 - std::exp(-4 * strength)) * (1 - 4 * std::min(0.2, seen->surface.gloss));
  if (chance > kept) return std::nullopt;
  return Return{ray.origin + (seen->distance + noise) * ray.direction, intensity};
}

Matrix4d pose_at(const Vector3d& position, double yaw) { return pose_from(turn_about_z(yaw), position); }

}  // namespace

const Mount& mount_of(const std::string& camera) {
  for (const Mount& mount : kMounts) {
    if (camera == mount.camera) return mount;
  }
  throw Error(Fault::usage, text("there is no camera ", camera));
}

Matrix4d world_from_ego(const MadeStreet& street, double time) {
  const Course& course = street.world.course;
  const double along = street.ego.along + time * street.ego.speed;
  const Eigen::Vector2d place = course.place(along, street.ego.right);
  const double sway = street.sway * kDegree * std::sin(2 * M_PI * time);
  return pose_at({place.x(), place.y(), 0}, course.yaw(along) + sway);
}

Matrix4d world_from_camera(const MadeStreet& street, const Mount& mount, double time) {
  // 0.6 m from a middle that lies 0.4 m before the LiDAR, 1.65 m high.
  const Matrix4d ego_from_head = pose_at({0, 0.4, 1.65}, mount.yaw);
  const Matrix4d head_from_camera = pose_from(Eigen::Matrix3d{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}, {0, 0.6, 0});
  return world_from_ego(street, time) * ego_from_head * head_from_camera;
}

Matrix4d world_from_lidar(const MadeStreet& street, double time) {
  return world_from_ego(street, time) * pose_at({0, 0, 1.9}, 0);
}

StreetPicture take_picture(const MadeStreet& street, const Exposure& exposure) {
  const Camera& camera = exposure.camera;
  const std::size_t pixels = std::size_t(camera.width) * std::size_t(camera.height);
  StreetPicture picture{{camera.width, camera.height, 3, {}}, {}, {}};
  picture.image.pixels.resize(3 * pixels);
  picture.actor.resize(pixels);
  picture.depth.resize(pixels);
  const StreetMoment still(street.world, exposure.time, exposure.turn);
  in_parallel(std::size_t(camera.height), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    const double time = exposure.time + exposure.duration * ((y + 0.5) / camera.height - 0.5);
    const Matrix4d pose = world_from_camera(street, *exposure.mount, time);
    if (exposure.duration == 0) return Row(still, camera, pose, y).draw(picture);
    Row(StreetMoment(street.world, time, exposure.turn), camera, pose, y).draw(picture);
  });
  return picture;
}

namespace {

/// One LiDAR's beams while it turns.
struct Pattern {
  int sensor, beams, columns;
  Vector3d place;       // in the axes of the LiDAR that turns
  double turn;          // radians that its columns cover, clockwise, ahead in their middle
  double lowest, rise;  // degrees: of the lowest beam, and from there to the highest
};

/// Where a ray in the car's axes enters its box.
std::optional<double> car_distance(const CarBox& car, const Vector3d& origin, const Vector3d& way) {
  double enter = 0, leave = kReach;
  for (int axis = 0; axis < 3; ++axis) {
    const double middle = (car.centre[axis] - origin[axis]) / way[axis],
                 half = std::abs(0.5 * car.size[axis] / way[axis]);
    enter = std::max(enter, middle - half);
    leave = std::min(leave, middle + half);
  }
  return enter < leave ? std::optional(enter) : std::nullopt;
}

void add_returns(const MadeStreet& street, const Spin& spin, const Pattern& pattern, LidarPoints& points) {
  constexpr double kCarIntensity = 0.3;  // intensity of the car's own body
  const StreetMoment still(street.world, spin.time);
  std::vector<std::vector<Return>> returns(std::size_t(pattern.columns));
  const auto share_of = [&](int column) { return (column + 0.5) / pattern.columns - 0.5; };
  in_parallel(returns.size(), [&](std::size_t at) {
    const int column = static_cast<int>(at);
    HostRandom random(mixed(spin.seed) + std::uint64_t(column));
    const double time = spin.time + (spin.moving ? kTurnTime * share_of(column) : 0);
    const std::optional<StreetMoment> now =
        spin.moving ? std::optional<StreetMoment>(std::in_place, street.world, time) : std::nullopt;
    const Matrix4d pose = world_from_lidar(street, time);
    const double yaw = -pattern.turn * share_of(column);
    for (int beam = 0; beam < pattern.beams; ++beam) {
      const double up =
          (pattern.lowest + pattern.rise * (pattern.beams > 1 ? double(beam) / (pattern.beams - 1) : 0.5)) * kDegree;
      const Vector3d way(-std::sin(yaw) * std::cos(up), std::cos(yaw) * std::cos(up), std::sin(up));
      const Ray ray{(pose * pattern.place.homogeneous()).head<3>(), pose.topLeftCorner<3, 3>() * way};
      const auto found = lidar_return(now ? *now : still, ray, random);
      const auto body = spin.car ? car_distance(*spin.car, pattern.place, way) : std::nullopt;
      if (body)
        returns[at].push_back({ray.origin + *body * ray.direction, kCarIntensity});
      else if (found)
        returns[at].push_back(*found);
    }
  });
  for (int column = 0; column < pattern.columns; ++column) {
    for (const Return& found : returns[std::size_t(column)]) {
      for (const double value : found.point) points.positions.push_back(static_cast<float>(value));
      points.intensities.push_back(static_cast<float>(found.intensity));
      points.times.push_back(static_cast<float>(kTurnTime * share_of(column)));
      points.sensors.push_back(static_cast<std::uint8_t>(pattern.sensor));
    }
  }
}

}  // namespace

LidarPoints take_sweep(const MadeStreet& street, const Spin& spin) {
  LidarPoints points;
  add_returns(street, spin, {0, spin.beams, spin.columns, Vector3d::Zero(), 2 * M_PI, -24, 36}, points);
  return points;
}

void add_ahead(const MadeStreet& street, const Spin& spin, const Vector3d& place, LidarPoints& points) {
  Spin other = spin;
  other.seed = mixed(spin.seed ^ 0x6168656164);
  add_returns(street, other,
              {1, std::max(1, spin.beams / 2), std::max(1, spin.columns / 6), place, 60 * kDegree, -10, 16}, points);
}

}  // namespace cloam
