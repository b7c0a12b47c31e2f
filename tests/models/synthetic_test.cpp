// The synthetic scene: reproducible, and its files agree with the geometry that they were made from.
#include <doctest/doctest.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "models/io/image.h"
#include "models/synth/ray_cast.h"
#include "models/synth/synthetic_scene.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;
using Eigen::Vector3d;
namespace fs = std::filesystem;

namespace {

nlohmann::json transforms(const fs::path& folder, const std::string& split) {
  return nlohmann::json::parse(content_of(folder / ("transforms_" + split + ".json")));
}

Eigen::Matrix4d matrix_of(const nlohmann::json& frame) {
  Eigen::Matrix4d matrix;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) matrix(r, c) = frame["transform_matrix"][size_t(r)][size_t(c)].get<double>();
  }
  return matrix;
}

/// Column and row of the pixel that sees the point, by the rule of the format: OpenGL axes, f = W / (2 tan(angle/2)).
Eigen::Vector2d project(const Eigen::Matrix4d& world_from_camera, const Vector3d& point, double angle, int size) {
  const Eigen::Vector4d p = world_from_camera.inverse() * point.homogeneous();
  const double focal = 0.5 * size / std::tan(0.5 * angle);
  return {0.5 * size + focal * p.x() / -p.z(), 0.5 * size - focal * p.y() / -p.z()};
}

Vector3d linear_pixel(const Image& image, const Eigen::Vector2d& at) {
  const auto first = size_t((int(at.y()) * image.width + int(at.x())) * image.channels);
  Vector3d colour;
  for (int c = 0; c < 3; ++c) {
    const double s = image.pixels[first + size_t(c)] / 255.0;
    colour[c] = s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
  }
  return colour;
}

double alpha(const Image& image, int x, int y) { return image.pixels[size_t((y * image.width + x) * 4 + 3)] / 255.0; }

/// Light changes the brightness of a plain paint a lot and its hue a little.
bool same_paint(const Vector3d& seen, const Vector3d& paint) {
  return seen.normalized().dot(paint.normalized()) > 0.97;
}

}  // namespace

TEST_CASE("synthetic scene: equal seeds give equal bytes, other seeds another scene") {
  const Folder a, b, c;
  write_synthetic_scene(a.path, {.train = 2, .test = 1, .size = 24, .seed = 5});
  write_synthetic_scene(b.path, {.train = 2, .test = 1, .size = 24, .seed = 5});
  write_synthetic_scene(c.path, {.train = 2, .test = 1, .size = 24, .seed = 6});
  for (const char* name :
       {"train/r_0.png", "train/r_1.png", "test/r_0.png", "transforms_train.json", "transforms_test.json"}) {
    CAPTURE(name);
    CHECK_FALSE(content_of(a.path / name).empty());
    CHECK(content_of(a.path / name) == content_of(b.path / name));
  }
  CHECK(content_of(a.path / "train/r_0.png") != content_of(c.path / "train/r_0.png"));
  CHECK(content_of(a.path / "transforms_train.json") != content_of(c.path / "transforms_train.json"));
}

TEST_CASE("synthetic scene: cameras are rigid, 4 away on the upper half, and look at the origin") {
  const Folder folder;
  write_synthetic_scene(folder.path, {.train = 12, .test = 3, .size = 8, .seed = 1});
  const nlohmann::json json = transforms(folder.path, "train");
  REQUIRE(json["frames"].size() == 12);
  for (const auto& frame : json["frames"]) {
    const Eigen::Matrix4d pose = matrix_of(frame);
    const Eigen::Matrix3d turn = pose.block<3, 3>(0, 0);
    CHECK((turn.transpose() * turn - Eigen::Matrix3d::Identity()).norm() < 1e-12);
    CHECK(turn.determinant() == doctest::Approx(1.0));
    const Vector3d centre = pose.block<3, 1>(0, 3);
    CHECK(centre.norm() == doctest::Approx(4.0));
    CHECK(centre.z() > 0);
    CHECK((turn.col(2) - centre / 4).norm() < 1e-12);
    CHECK(turn(2, 1) > 0);  // the image's up is up
  }
}

TEST_CASE("synthetic scene: a ball that faces the camera is seen where the written pose puts its centre") {
  const Folder folder;
  const int size = 96;
  write_synthetic_scene(folder.path, {.train = 16, .test = 8, .size = size, .seed = 0});
  int seen = 0;
  for (const std::string split : {"train", "test"}) {
    const auto json = transforms(folder.path, split);
    for (const auto& frame : json["frames"]) {
      const Image image = read_image(folder.path / (frame["file_path"].get<std::string>() + ".png"));
      REQUIRE(image.channels == 4);
      const Eigen::Matrix4d pose = matrix_of(frame);
      for (const SyntheticBall& ball : synthetic_balls(0)) {
        // Nothing stands between the rim of the board and a camera on the same side of the scene.
        const Vector3d camera = pose.block<3, 1>(0, 3);
        if (camera.head<2>().normalized().dot(ball.centre.head<2>().normalized()) < 0.9) continue;
        const Eigen::Vector2d at = project(pose, ball.centre, json["camera_angle_x"].get<double>(), size);
        CAPTURE(frame["file_path"].get<std::string>());
        CHECK(same_paint(linear_pixel(image, at), ball.colour));
        CHECK(alpha(image, int(at.x()), int(at.y())) == 1.0);
        ++seen;
      }
    }
  }
  CHECK(seen >= 8);
}

TEST_CASE("synthetic scene: the background is transparent, the scene fits the frame, borders are partly covered") {
  const Folder folder;
  const int size = 64;
  write_synthetic_scene(folder.path, {.train = 6, .test = 1, .size = size, .seed = 3});
  for (int i = 0; i < 6; ++i) {
    const Image image = read_image(folder.path / text("train/r_", i, ".png"));
    int partly = 0;
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const double cover = alpha(image, x, y) * 4;
        CHECK(std::abs(cover - std::round(cover)) < 0.02);  // quarters, from 2x2 samples
        partly += cover > 0.5 && cover < 3.5;
        if (x == 0 || y == 0 || x == size - 1 || y == size - 1) CHECK(cover == 0);
      }
    }
    CHECK(partly > size / 2);
  }
}

TEST_CASE("synthetic scene: sizes below 1 are refused") {
  const Folder folder;
  CHECK_THROWS_AS(write_synthetic_scene(folder.path, {.train = 0}), Error);
  CHECK_THROWS_AS(write_synthetic_scene(folder.path, {.size = -1}), Error);
}

TEST_CASE("rays: closed forms of sphere, box and cylinder") {
  const Ray down{{0.3, 0.1, 5}, {0, 0, -1}};
  const auto ball = make_sphere(1)->hit(down, 0);
  REQUIRE(ball);
  CHECK(ball->distance == doctest::Approx(5 - std::sqrt(1 - 0.1)));
  CHECK((ball->normal - Vector3d(0.3, 0.1, std::sqrt(0.9))).norm() < 1e-12);
  const auto box = make_box({1, 1, 0.25})->hit(down, 0);
  REQUIRE(box);
  CHECK(box->distance == doctest::Approx(4.75));
  CHECK(box->normal == Vector3d(0, 0, 1));
  CHECK_FALSE(make_box({0.2, 1, 1})->hit(down, 0));
  const auto cylinder = make_revolution({{0, -1}, {1, -1}, {1, 1}, {0, 1}});
  CHECK(cylinder->hit(down, 0)->distance == doctest::Approx(4.0));
  const auto side = cylinder->hit({{-3, 0.6, 0.2}, {1, 0, 0}}, 0);
  REQUIRE(side);
  CHECK(side->distance == doctest::Approx(3 - 0.8));
  CHECK((side->normal - Vector3d(-0.8, 0.6, 0)).norm() < 1e-9);
  CHECK_FALSE(cylinder->hit({{-3, 1.1, 0.2}, {1, 0, 0}}, 0));
}

TEST_CASE("rays: a turned half circle is a sphere, a whole ring a torus") {
  std::vector<Eigen::Vector2d> half_circle;
  for (int i = 0; i <= 400; ++i) half_circle.push_back({std::sin(M_PI * i / 400), -std::cos(M_PI * i / 400)});
  half_circle.front().x() = half_circle.back().x() = 0;
  const auto turned = make_revolution(half_circle);
  const auto sphere = make_sphere(1);
  const auto ring = make_ring({0.7, 0.1, 0, -1});
  for (int i = 0; i < 200; ++i) {
    const Vector3d from(3 * std::cos(i), 3 * std::sin(i), 2 * std::sin(0.37 * i));
    const Ray ray{from,
                  (Vector3d(0.9 * std::sin(1.7 * i), 0.5 * std::cos(2.3 * i), 0.4 * std::sin(i)) - from).normalized()};
    const auto want = sphere->hit(ray, 0), got = turned->hit(ray, 0);
    if (want && want->normal.dot(ray.direction) < -0.1) {
      REQUIRE(got);
      CHECK(got->distance == doctest::Approx(want->distance).epsilon(1e-4));
      CHECK(got->normal.dot(want->normal) > 0.9999);
    }
    if (const auto hit = ring->hit(ray, 0)) {
      const Vector3d p = ray.origin + hit->distance * ray.direction;
      CHECK(std::hypot(std::hypot(p.x(), p.z()) - 0.7, p.y()) == doctest::Approx(0.1).epsilon(1e-5));
    }
  }
}

TEST_CASE("rays: a solid between a surface and the sun throws a shadow") {
  const auto white = [](const Vector3d&) { return Vector3d(1, 1, 1); };
  const SceneObject floor{make_box({5, 5, 0.1}), white, {0, 0, -0.1}};
  const SceneObject roof{make_box({5, 5, 0.1}), white, {0, 0, 3}};
  const Ray low{{0, 0, 1}, {0, 0, -1}};
  const auto open = shade({floor}, low), covered = shade({floor, roof}, low);
  REQUIRE(open);
  REQUIRE(covered);
  CHECK(covered->sum() < 0.6 * open->sum());
  CHECK_FALSE(shade({floor}, {{0, 0, 1}, {0, 0, 1}}));
}
