// Focal lengths that are learned: the lens that has them, against the projection; that a wrong one comes back.
// pose_refinement_test.cpp has the gradients in them.
#include "models/methods/focal_refinement.h"

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

constexpr double kWrong = 1.03;  // focal lengths as given over the true ones

Scene made_scene(const Folder& folder, int side, int photos) {
  write_synthetic_scene(folder.path / "data", {photos, 2, side, 3});
  return read_scene(folder.path / "data");
}

Scene with_wrong_focals(Scene scene) {
  for (Camera& camera : scene.cameras) camera.fx *= kWrong, camera.fy *= kWrong;
  return scene;
}

/// Of the focal length of the scene's only camera, what is left of the error.
double share_left(Method& method) {
  const std::vector<double> factors = as<RefinesCameras>(method)->focal_factors(0);
  REQUIRE(factors.size() == 1);
  return std::abs(factors[0] * kWrong - 1) / (kWrong - 1);
}

}  // namespace

TEST_CASE("a lens with another focal length sees the same picture narrower or wider, its distortion too") {
  Camera camera{640, 480, 500, 510, 330, 235, CameraModel::opencv, {-0.2, 0.05, -0.01, 0.003}, 0.002, -0.003};
  camera.denominator = {0.02, -0.01, 0.004};
  camera.prism = {0.001, -0.002};
  const double factor = 1.2;
  const Camera longer = with_focal(camera, factor);
  for (const double x : {-0.4, 0.0, 0.3})
    for (const double y : {-0.3, 0.1, 0.25}) {
      const Eigen::Vector2d was = project(camera, {x, y, 1}), is = project(longer, {x / factor, y / factor, 1});
      CHECK((was - is).norm() < 1e-9);
    }
}

TEST_CASE("splat: a wrong focal length comes to that with which the photos show the gaussians") {
  const Folder folder;
  const Scene scene = made_scene(folder, 48, 4), begun = with_wrong_focals(scene);
  const Settings settings = {{"initial", "random"},      {"initial.random", "400"},     {"background", "white"},
                             {"growth.start", "100000"}, {"intrinsics.refine", "true"}, {"intrinsics.rate", "5e-3"}};
  const auto model = configured("splat", settings);
  model->build({scene}, 7);
  make_sharp(*model);
  const auto method = configured("splat", settings);
  method->build({begun}, 7);
  load_data(*method, begun, painted(load_images(begun, Split::train), *model, scene));
  learn_alone(*method, "intrinsics.", *model, 300);
  const double left = share_left(*method);
  MESSAGE("left ", left);
  CHECK(left < 0.1);
}

TEST_CASE("focal lengths of a fisheye are not learned, and that is told") {
  const Folder folder;
  Scene scene = made_scene(folder, 8, 2);
  scene.cameras[0].model = CameraModel::fisheye;
  const auto method = configured("nerf", {{"intrinsics.refine", "true"}});
  CHECK(holds(error_of([&] { method->build({scene}, 7); }, Fault::usage), "intrinsics.refine"));
}
