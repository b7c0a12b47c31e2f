// Start reading at make_objects for the things, at make_cameras for the views.
#include "models/synth/synthetic_scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <utility>

#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/synth/procedural.h"
#include "models/synth/ray_cast.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
constexpr double kFieldOfView = 0.6911112070083618;  // as in the NeRF-synthetic scenes
constexpr double kCameraDistance = 4.0;
constexpr double kBoardTop = -0.62;
constexpr int kSamplesPerSide = 2;
const Vector3d kInk(0.07, 0.04, 0.035);  // the dark paint of the jar

bool odd(double cells) { return static_cast<long>(std::floor(cells)) & 1; }

/// Linear RGB of the paints on the shelf; any whole number names one.
Vector3d paint(int index) {
  static const std::array<Vector3d, 7> paints{{{0.62, 0.09, 0.05},    // brick
                                               {0.03, 0.27, 0.29},    // teal
                                               {0.78, 0.44, 0.05},    // ochre
                                               {0.08, 0.13, 0.42},    // indigo
                                               {0.25, 0.36, 0.07},    // olive
                                               {0.78, 0.27, 0.20},    // coral
                                               {0.20, 0.43, 0.66}}};  // sky
  return paints[static_cast<size_t>(index) % paints.size()];
}

Albedo plain(const Vector3d& colour) {
  return [colour](const Vector3d&) { return colour; };
}

Albedo board_checker() {
  return [](const Vector3d& p) {
    const double radius = std::hypot(p.x(), p.y());
    const Vector3d wood = mix({0.34, 0.17, 0.07}, {0.50, 0.28, 0.13}, noise({3 * p.x(), 3 * p.y(), 25 * radius}));
    if (radius > 1.02 || p.z() < -1e-3) return wood;
    const bool dark = odd(p.x() / 0.255) != odd(p.y() / 0.255);
    return dark ? Vector3d(0.10, 0.17, 0.22) : Vector3d(0.78, 0.72, 0.60);
  };
}

/// Terracotta with painted rings and a zigzag, as on geometric Greek ware. z is measured from the foot.
Albedo painted_clay(double height, int teeth) {
  return [height, teeth](const Vector3d& p) -> Vector3d {
    const double z = p.z() / height;
    const double around = std::atan2(p.y(), p.x()) / (2 * kPi) * teeth;
    const Vector3d clay = mix({0.52, 0.19, 0.08}, {0.66, 0.28, 0.13}, noise(7 * p));
    const Vector3d slip(0.80, 0.70, 0.52);
    const double tooth = 2 * std::abs(around - std::floor(around) - 0.5);
    if (z > 0.43 && z < 0.60) return (z - 0.43) / 0.17 < tooth ? kInk : slip;
    const bool ring = (z > 0.39 && z < 0.43) || (z > 0.60 && z < 0.64) || (z > 0.93) || (z > 0.12 && z < 0.16);
    return ring ? kInk : (z > 0.20 && z < 0.24) ? slip : clay;
  };
}

Albedo checkered(const Vector3d& colour, double cell) {
  return [=](const Vector3d& p) -> Vector3d {
    // Shifted by a hair so that faces do not lie on cell borders.
    const Vector3d q = (p.array() + 1e-4) / cell;
    const bool dark = odd(q.x()) != (odd(q.y()) != odd(q.z()));
    return dark ? colour : Vector3d(0.82, 0.78, 0.70);
  };
}

Albedo striped(const Vector3d& colour, double width) {
  return [=](const Vector3d& p) -> Vector3d { return odd(p.z() / width) ? colour : Vector3d(0.85, 0.82, 0.76); };
}

std::vector<Vector2d> jar_profile(double belly) {
  const std::vector<Vector2d> outside{{0.21, 0.00}, {0.23, 0.04}, {0.27, 0.16},  {belly, 0.52}, {0.95 * belly, 0.70},
                                      {0.26, 0.98}, {0.22, 1.10}, {0.245, 1.22}, {0.31, 1.29}};
  const std::vector<Vector2d> inside{{0.29, 1.305},       {0.215, 1.22},        {0.18, 1.10}, {0.22, 0.98},
                                     {0.9 * belly, 0.69}, {0.91 * belly, 0.52}, {0.20, 0.12}, {0, 0.10}};
  std::vector<Vector2d> profile{{0, 0}};
  for (const auto* side : {&outside, &inside}) {
    const auto curve = smooth_profile(*side, 5);
    profile.insert(profile.end(), curve.begin(), curve.end());
  }
  return profile;
}

/// Where things stand on the board: angle about the middle and distance from it.
Vector3d on_board(double angle, double distance, double height) {
  return {distance * std::cos(angle), distance * std::sin(angle), kBoardTop + height};
}

/// All random choices of a seed, drawn in one fixed order.
struct Arrangement {
  double turn = 0, belly = 0, block_turn = 0, tilt = 0;
  int first_paint = 0, teeth = 0;

  explicit Arrangement(uint64_t seed) {
    HostRandom random(seed);
    turn = random.between(0, 2 * kPi);
    first_paint = static_cast<int>(random.between(0, 7));
    belly = random.between(0.42, 0.48);
    block_turn = random.between(0.2, 1.2);
    tilt = random.between(-0.12, 0.12);
    teeth = 10 + static_cast<int>(random.between(0, 5));
  }
};

SceneObject put(std::unique_ptr<Solid> solid, Albedo albedo, const Vector3d& centre, double turn = 0) {
  return {std::move(solid), std::move(albedo), centre, turn_about_z(turn)};
}

void add_jar(std::vector<SceneObject>& objects, const Arrangement& choice) {
  const Vector3d foot = on_board(choice.turn, 0.12, 0);
  objects.push_back(put(make_revolution(jar_profile(choice.belly)), painted_clay(1.3, choice.teeth), foot));
  const double centre = 0.30, height = 0.99;  // of the handles, from the jar's axis and foot
  for (const double side : {0.5 * kPi, 1.5 * kPi}) {
    const double turn = choice.turn + side;
    const Vector3d offset(centre * std::cos(turn), centre * std::sin(turn), height);
    objects.push_back(put(make_ring({0.17, 0.035, -centre, 0.205}), plain(kInk), foot + offset, turn));
  }
}

void add_blocks(std::vector<SceneObject>& objects, const Arrangement& choice) {
  const double at = choice.turn + 1.15, turn = choice.turn + choice.block_turn;
  const int colour = choice.first_paint;
  objects.push_back(
      put(make_box({0.21, 0.21, 0.21}), checkered(paint(colour + 3), 0.14), on_board(at, 0.74, 0.21), turn));
  objects.push_back(
      put(make_box({0.13, 0.13, 0.13}), plain(paint(colour + 2)), on_board(at - 0.05, 0.74, 0.55), turn + 0.6));
  const std::vector<Vector2d> cone{{0, 0}, {0.20, 0}, {0.20, 0.03}, {0.02, 0.48}, {0, 0.49}};
  objects.push_back(put(make_revolution(cone), striped(paint(colour + 6), 0.1), on_board(choice.turn + 5.3, 0.76, 0)));
}

/// A striped ball on a flat striped block.
void add_pedestal(std::vector<SceneObject>& objects, const Arrangement& choice) {
  const double at = choice.turn + 4.05 + choice.tilt, radius = 0.15;
  objects.push_back(put(make_box({0.10, 0.30, 0.07}), striped(paint(choice.first_paint + 1), 0.047),
                        on_board(at, 0.80, 0.07), choice.turn + 4.3));
  objects.push_back(
      put(make_sphere(radius), striped(paint(choice.first_paint), 0.075), on_board(at, 0.80, 0.14 + radius)));
}

std::vector<SceneObject> make_objects(uint64_t seed) {
  const Arrangement choice(seed);
  std::vector<SceneObject> objects;
  const std::vector<Vector2d> board{{0, -0.1}, {1.10, -0.1}, {1.14, -0.05}, {1.10, 0}, {0, 0}};
  objects.push_back(put(make_revolution(board), board_checker(), {0, 0, kBoardTop}, choice.turn));
  add_jar(objects, choice);
  add_blocks(objects, choice);
  add_pedestal(objects, choice);
  for (const SyntheticBall& ball : synthetic_balls(seed)) {
    objects.push_back(put(make_sphere(ball.radius), plain(ball.colour), ball.centre));
  }
  return objects;
}

/// world_from_camera with OpenGL axes: x right, y up, the camera looks along -z at the origin.
Matrix4d look_at_origin(double azimuth, double elevation) {
  const Vector3d back(std::cos(azimuth) * std::cos(elevation), std::sin(azimuth) * std::cos(elevation),
                      std::sin(elevation));
  const Vector3d right(-std::sin(azimuth), std::cos(azimuth), 0);
  Matrix4d world_from_camera = Matrix4d::Identity();
  world_from_camera.block<3, 1>(0, 0) = right;
  world_from_camera.block<3, 1>(0, 1) = back.cross(right);
  world_from_camera.block<3, 1>(0, 2) = back;
  world_from_camera.block<3, 1>(0, 3) = kCameraDistance * back;
  return world_from_camera;
}

/// Golden-angle spiral over the upper half: even in area, no two views in line.
std::vector<Matrix4d> train_cameras(int count, uint64_t seed) {
  HostRandom random(seed ^ 0x7261696e);
  std::vector<Matrix4d> cameras;
  for (int i = 0; i < count; ++i) {
    const double height = 0.06 + 0.90 * (i + random.between(0.2, 0.8)) / count;  // sine of the elevation
    const double azimuth = i * kPi * (3 - std::sqrt(5.0)) + random.between(-0.15, 0.15);
    cameras.push_back(look_at_origin(azimuth, std::asin(height)));
  }
  return cameras;
}

/// One orbit that rises and falls between 20 and 45 degrees.
std::vector<Matrix4d> test_cameras(int count) {
  std::vector<Matrix4d> cameras;
  for (int i = 0; i < count; ++i) {
    const double azimuth = 2 * kPi * (i + 0.5) / count;
    cameras.push_back(look_at_origin(azimuth, (32.5 + 12.5 * std::sin(2 * azimuth)) * kPi / 180));
  }
  return cameras;
}

/// Sum over the samples of one pixel: encoded colour in [0,1] and, last, how many hit something.
Eigen::Vector4d pixel_sum(const std::vector<SceneObject>& objects, const Matrix4d& world_from_camera, Vector2d corner,
                          int size) {
  const double focal = 0.5 * size / std::tan(0.5 * kFieldOfView);
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (int sample = 0; sample < kSamplesPerSide * kSamplesPerSide; ++sample) {
    const double x = corner.x() + (sample % kSamplesPerSide + 0.5) / kSamplesPerSide;
    const double y = corner.y() + (double(sample / kSamplesPerSide) + 0.5) / kSamplesPerSide;
    const Vector3d in_camera((x - 0.5 * size) / focal, -(y - 0.5 * size) / focal, -1);
    const Ray ray{world_from_camera.block<3, 1>(0, 3), (world_from_camera.block<3, 3>(0, 0) * in_camera).normalized()};
    if (const auto colour = shade(objects, ray)) {
      sum += Eigen::Vector4d(srgb(colour->x()), srgb(colour->y()), srgb(colour->z()), 1);
    }
  }
  return sum;
}

Image render(const std::vector<SceneObject>& objects, const Matrix4d& world_from_camera, int size) {
  Image image{size, size, 4, {}};
  image.pixels.reserve(size_t(size) * size_t(size) * 4);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const Eigen::Vector4d sum = pixel_sum(objects, world_from_camera, Vector2d(x, y), size);
      const double hits = std::max(1.0, sum.w());
      for (int c = 0; c < 3; ++c) image.pixels.push_back(static_cast<uint8_t>(std::lround(255 * sum[c] / hits)));
      image.pixels.push_back(static_cast<uint8_t>(std::lround(255 * sum.w() / (kSamplesPerSide * kSamplesPerSide))));
    }
  }
  return image;
}

nlohmann::ordered_json rows_of(const Matrix4d& matrix) {
  auto rows = nlohmann::ordered_json::array();
  for (int r = 0; r < 4; ++r) rows.push_back({matrix(r, 0), matrix(r, 1), matrix(r, 2), matrix(r, 3)});
  return rows;
}

void write_split(const std::filesystem::path& folder, const std::string& split, const std::vector<SceneObject>& objects,
                 const std::vector<Matrix4d>& cameras, int size) {
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  for (size_t i = 0; i < cameras.size(); ++i) {
    const std::string name = text(split, "/r_", i);
    write_png(folder / (name + ".png"), render(objects, cameras[i], size));
    frames.push_back({{"file_path", "./" + name}, {"transform_matrix", rows_of(cameras[i])}});
  }
  const nlohmann::ordered_json all{{"camera_angle_x", kFieldOfView}, {"frames", frames}};
  commit_text(folder / ("transforms_" + split + ".json"), all.dump(1) + "\n");
}

}  // namespace

std::vector<SyntheticBall> synthetic_balls(uint64_t seed) {
  const Arrangement choice(seed);
  const auto ball = [&](double angle, double distance, double radius, int colour) {
    return SyntheticBall{on_board(choice.turn + angle, distance, radius), radius, paint(choice.first_paint + colour)};
  };
  return {ball(2.35, 0.72, 0.24, 5), ball(3.05, 0.72, 0.14, 4), ball(0.1, 0.88, 0.13, 1)};
}

void write_synthetic_scene(const std::filesystem::path& folder, const SyntheticOptions& options) {
  if (options.train < 1 || options.test < 1 || options.size < 1 || options.size > 4096) {
    throw Error(Fault::usage,
                text("a synthetic scene needs at least 1 training view, 1 test view and 1 to 4096 pixels per side, ",
                     "got ", options.train, ", ", options.test, " and ", options.size));
  }
  const std::vector<SceneObject> objects = make_objects(options.seed);
  write_split(folder, "train", objects, train_cameras(options.train, options.seed), options.size);
  write_split(folder, "test", objects, test_cameras(options.test), options.size);
}

}  // namespace cloam
