// Lenses that are learned: the lens as a camera, against the projection; that a wrong one comes back.
// pose_refinement_test.cpp has the gradients in them.
#include "models/methods/lens_refinement.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/splat/draw.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/refines_cameras.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/learned_cameras.h"

using namespace cloam;

namespace {

constexpr double kWrong = 1.03;                // focal lengths as given over the true ones
const Eigen::Vector2d kAside = {0.03, -0.02};  // principal points as given, in focal lengths from the true ones

Scene made_scene(const Folder& folder, int side, int photos) {
  write_synthetic_scene(folder.path / "data", {photos, 2, side, 3});
  return read_scene(folder.path / "data");
}

Scene with_wrong_lens(Scene scene) {
  for (Camera& camera : scene.cameras) {
    camera.cx += camera.fx * kAside.x(), camera.cy += camera.fy * kAside.y();
    camera.fx *= kWrong, camera.fy *= kWrong;
  }
  return scene;
}

/// What is left of the errors of the scene's only camera.
struct LensLeft {
  double focal, centre;
};
LensLeft left_of(Method& method, const Scene& truth, const Scene& given) {
  const std::vector<LensChange> changes = as<RefinesCameras>(method)->lens_changes(0);
  REQUIRE(changes.size() == 1);
  const Camera &true_one = truth.cameras[0], learned = with_lens(given.cameras[0], changes[0]);
  return {std::abs(learned.fx / true_one.fx - 1) / (kWrong - 1),
          std::hypot(learned.cx - true_one.cx, learned.cy - true_one.cy) / (true_one.fx * kAside.norm())};
}

void check_refused(const Camera& camera, const Settings& settings, const char* words) {
  const Folder folder;
  Scene scene = made_scene(folder, 8, 2);
  scene.cameras[0].model = camera.model;
  const auto method = configured("nerf", settings);
  CHECK(holds(error_of([&] { method->build({scene}, 7); }, Fault::usage), words));
}

}  // namespace

TEST_CASE("a lens with another focal length sees the same picture narrower or wider, its distortion too") {
  Camera camera{640, 480, 500, 510, 330, 235, CameraModel::opencv, {-0.2, 0.05, -0.01, 0.003}, 0.002, -0.003};
  camera.denominator = {0.02, -0.01, 0.004};
  camera.prism = {0.001, -0.002};
  const double factor = 1.2;
  const Camera longer = with_lens(camera, {.focal = factor});
  for (const double x : {-0.4, 0.0, 0.3})
    for (const double y : {-0.3, 0.1, 0.25}) {
      const Eigen::Vector2d was = project(camera, {x, y, 1}), is = project(longer, {x / factor, y / factor, 1});
      CHECK((was - is).norm() < 1e-9);
    }
}

TEST_CASE("a pinhole with another principal point sees the same picture beside where it was") {
  const Camera camera{640, 480, 500, 510, 330, 235};
  const LensChange change{1.2, {0.02, -0.05}};
  const Camera changed = with_lens(camera, change);
  const Eigen::Vector2d was = project(camera, {0.3, -0.2, 1});
  const Eigen::Vector2d is = project(changed, {(0.3 - 0.02) / 1.2, (-0.2 + 0.05) / 1.2, 1});
  CHECK((was - is).norm() < 1e-9);
  const LearnedLenses learned = {from_host(std::vector<float>{9, 1.2f}, {2, 1}),
                                 from_host(std::vector<float>{9, 9, 0.02f, -0.05f}, {2, 2})};
  const Tensor whose = from_host(std::vector<int32_t>{1}, {1});
  const std::vector<float> seen =
      directions_through(lenses_of(learned, whose), from_host(std::vector<float>{0.6f, -0.4f, 2}, {1, 3})).to_host();
  CHECK(seen[0] / seen[2] == doctest::Approx((0.3 - 0.02) / 1.2));
  CHECK(seen[1] / seen[2] == doctest::Approx((-0.2 + 0.05) / 1.2));
}

TEST_CASE("splat: a wrong lens comes to that with which the photos show the gaussians") {
  const Folder folder;
  const Scene scene = made_scene(folder, 48, 4), begun = with_wrong_lens(scene);
  const Settings settings = {{"initial", "random"},         {"initial.random", "400"},     {"background", "white"},
                             {"growth.start", "100000"},    {"intrinsics.refine", "true"}, {"intrinsics.rate", "5e-3"},
                             {"intrinsics.centres", "true"}};
  const auto model = configured("splat", settings);
  model->build({scene}, 7);
  make_sharp(*model);
  const auto method = configured("splat", settings);
  method->build({begun}, 7);
  load_data(*method, begun, painted(load_images(begun, Split::train), *model, scene));
  learn_alone(*method, "intrinsics.", *model, 300);
  const auto [focal, centre] = left_of(*method, scene, begun);
  MESSAGE("left of the focal length's error ", focal, ", of the principal point's ", centre);
  CHECK(focal < 0.1);
  CHECK(centre < 0.1);
}

TEST_CASE("lenses of a fisheye are not learned, nor principal points of a distorted picture, and that is told") {
  check_refused({.model = CameraModel::fisheye}, {{"intrinsics.refine", "true"}}, "setting intrinsics.refine or");
  check_refused({.model = CameraModel::fov}, {{"intrinsics.centres", "true"}},
                "1 of 1 cameras), which no method learns");
  check_refused({.model = CameraModel::opencv}, {{"intrinsics.centres", "true"}}, "a lens with distortion");
}
