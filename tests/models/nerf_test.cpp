// NeRF on a small scene made for the test: it must beat what a non-solution reaches, whatever the field.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/mesh/density_mesh.h"
#include "models/metrics/psnr.h"
#include "models/render/rays.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/shows_samples.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/volume.h"
#include "tests/models/made_method.h"
#include "tests/models/mean_colour.h"
#include "tests/models/resume.h"

using namespace cloam;

namespace {

constexpr uint64_t kSeed = 3;  // of the scene

/// Built for the scene, with its training photos.
std::unique_ptr<Method> loaded(const Scene& scene, const Settings& settings) {
  auto method = configured("nerf", settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train));
  return method;
}

struct Outcome {
  double psnr = 0, baseline = 0;
};

/// Trains on 20 views of 48x48, tests on 4: mean PSNR of the renders and of the training views' mean colour.
Outcome train_small(
    const Settings& settings, int64_t steps, const std::function<void(Method&)>& look = [](Method&) {}) {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {20, 4, 48, kSeed});
  const Scene scene = read_scene(folder.path / "data");
  const auto method = loaded(scene, settings);
  TrainOptions options;
  options.steps = steps;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});

  const Pixels test = load_images(scene, Split::test);
  Outcome out;
  for (const FramePixels& frame : test.frames) {
    const Picture picture =
        shown(*method, {test.cameras[static_cast<size_t>(frame.camera)], scene.frames[frame.frame].world_from_camera});
    out.psnr += psnr(picture.rgb, on_white(frame)) / static_cast<double>(test.frames.size());
  }
  out.baseline = mean_colour_figure(scene);
  look(*method);
  return out;
}

const Settings kSmallHash = small_hash();

/// The mean distance from the upper halves of the scene's balls, which cameras see, to the nearest vertex of the mesh.
double mesh_to_balls(Method& method) {
  const DensityField field = as<HasDensity>(method)->density_field();
  const Mesh mesh = density_mesh(field, {field.subject, 96, 10});
  double sum = 0;
  int count = 0;
  for (const SyntheticBall& ball : synthetic_balls(kSeed))
    for (double height = 0.1; height < 1; height += 0.2)
      for (double angle = 0; angle < 6; angle += 1) {
        const double across = std::sqrt(1 - height * height);
        const Eigen::Vector3d at =
            ball.centre + ball.radius * Eigen::Vector3d(across * std::cos(angle), across * std::sin(angle), height);
        double least = 3;
        for (size_t i = 0; i < mesh.positions.size(); i += 3)
          least = std::min(least, (Eigen::Map<const Eigen::Vector3f>(&mesh.positions[i]).cast<double>() - at).norm());
        sum += least;
        ++count;
      }
  return sum / count;
}

}  // namespace

TEST_CASE("nerf with the hash grid learns held-out views of a small scene") {
  const Outcome outcome = train_small(kSmallHash, 250, [](Method& method) {
    const double metres = mesh_to_balls(method);
    MESSAGE("from the balls to the mesh ", metres);
    CHECK(metres < 0.05);  // the box is 3 wide
  });
  MESSAGE("psnr ", outcome.psnr, ", mean colour ", outcome.baseline);
  CHECK(outcome.psnr > outcome.baseline + 7);
}

TEST_CASE("nerf with tri-planes learns held-out views of a small scene") {
  auto settings = kSmallHash;
  settings.insert(settings.end(),
                  {{"field.kind", "triplane"}, {"field.plane_side", "64"}, {"field.plane_channels", "8"}});
  const Outcome outcome = train_small(settings, 200);
  MESSAGE("psnr ", outcome.psnr, ", mean colour ", outcome.baseline);
  CHECK(outcome.psnr > outcome.baseline + 4);
}

TEST_CASE("the paper's sampling and network, made small, learn held-out views") {
  const Outcome outcome = train_small({{"field.kind", "frequency"},
                                       {"field.width", "64"},
                                       {"field.depth", "6"},
                                       {"sampling", "importance"},
                                       {"batch.rays", "128"},
                                       {"samples.coarse", "24"},
                                       {"samples.fine", "24"},
                                       {"train.rate", "3e-3"}},
                                      150);
  MESSAGE("psnr ", outcome.psnr, ", mean colour ", outcome.baseline);
  CHECK(outcome.psnr > outcome.baseline + 3);
}

TEST_CASE("nerf with evenly spread samples learns held-out views of a small scene") {
  auto settings = kSmallHash;
  settings.insert(settings.end(), {{"sampling", "uniform"}, {"batch.rays", "256"}, {"samples.coarse", "32"}});
  const Outcome outcome = train_small(settings, 150);
  MESSAGE("psnr ", outcome.psnr, ", mean colour ", outcome.baseline);
  CHECK(outcome.psnr > outcome.baseline + 4);
}

TEST_CASE("nerf: samples along a row of rays make up the picture's opacity and depth there") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {6, 1, 16, 3});
  const Scene scene = read_scene(folder.path / "data");
  const View view = view_of(scene.frames.front(), scene.cameras.front(), 0);
  const int width = view.camera.width, row = view.camera.height / 3;
  for (const char* sampling : {"occupancy", "importance", "uniform"}) {
    CAPTURE(sampling);
    const auto method = loaded(scene, {{"field.levels", "3"},
                                       {"field.log2_rows", "8"},
                                       {"field.width", "16"},
                                       {"occupancy.side", "8"},
                                       {"sampling", sampling},
                                       {"samples.coarse", "6"},
                                       {"samples.fine", "4"}});
    const Picture picture = shown(*method, view);
    const auto samples = as<ShowsSamples>(*method)->samples(view, row);
    const auto of = [&](int column) {
      std::vector<RaySample> ray;
      std::copy_if(samples.begin(), samples.end(), std::back_inserter(ray),
                   [&](const RaySample& sample) { return sample.column == column; });
      return ray;
    };
    for (int column = 0; column < width; column++) {
      const auto ray = of(column);
      double light = 0, depth = 0;
      for (const RaySample& sample : ray) light += sample.weight, depth += sample.weight * sample.distance;
      const auto pixel = static_cast<size_t>(row * width + column);
      CHECK(light == doctest::Approx(picture.opacity[pixel]).epsilon(1e-4));
      if (light > 1e-2) CHECK(depth / light == doctest::Approx(picture.depth[pixel]).epsilon(1e-4));
      const bool even = sampling == std::string("uniform");
      if (even) {
        REQUIRE(ray.size() == 6);
        for (size_t i = 2; i < ray.size(); i++)
          CHECK(ray[i].distance - ray[i - 1].distance ==
                doctest::Approx(ray[1].distance - ray[0].distance).epsilon(1e-3));
      }
      if (sampling == std::string("importance")) CHECK(ray.size() == 10);
    }
  }
}

TEST_CASE("nerf: a checkpoint of any step holds all that the next step and a render read") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {6, 1, 16, 3});
  const Scene scene = read_scene(folder.path / "data");
  const Settings marching = {{"field.levels", "3"},   {"field.log2_rows", "8"},   {"field.finest", "16"},
                             {"field.width", "16"},   {"batch.samples", "512"},   {"batch.rays", "32"},
                             {"occupancy.side", "8"}, {"occupancy.cells", "128"}, {"march.min_step", "0.1"}};
  const Settings importance = {{"field.kind", "frequency"}, {"field.width", "16"},   {"field.depth", "3"},
                               {"sampling", "importance"},  {"batch.rays", "16"},    {"samples.coarse", "6"},
                               {"samples.fine", "6"},       {"background", "random"}};
  const Settings uniform = {{"field.kind", "triplane"},
                            {"field.plane_side", "8"},
                            {"sampling", "uniform"},
                            {"batch.rays", "16"},
                            {"samples.coarse", "6"}};
  for (const Settings& settings : {marching, importance, uniform}) {
    CAPTURE(settings.front().second);
    const Frame& frame = scene.frames.front();
    check_resumes_from_every_step(
        {[&] { return loaded(scene, settings); },
         [&](Method& method) { return shown(method, view_of(frame, scene.cameras.front(), 0)).rgb; }});
  }
}

TEST_CASE("rays of a view point where the camera projects them") {
  Camera camera;
  camera.width = 7;
  camera.height = 5;
  camera.fx = camera.fy = 6;
  camera.cx = 3.5;
  camera.cy = 2.5;
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.block<3, 3>(0, 0) = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  pose.block<3, 1>(0, 3) = Eigen::Vector3d(0.5, -2, 1);
  SceneFrame frame;
  frame.centre = Eigen::Vector3d(0.1, 0.2, 0.3);
  frame.scale = 0.4;
  frame.contract = true;
  const Rays rays = view_rays({camera, pose}, frame, {});
  const std::vector<float> origins = rays.origins.to_host(), directions = rays.directions.to_host();
  for (int y = 0; y < camera.height; y++)
    for (int x = 0; x < camera.width; x++) {
      const size_t i = static_cast<size_t>(y * camera.width + x);
      Eigen::Vector3d point;
      for (int k = 0; k < 3; k++)
        point[k] = (static_cast<double>(origins[3 * i + static_cast<size_t>(k)]) +
                    1.3 * static_cast<double>(directions[3 * i + static_cast<size_t>(k)])) /
                       frame.scale +
                   frame.centre[k];
      const Eigen::Vector3d in_camera = pose.block<3, 3>(0, 0).transpose() * (point - pose.block<3, 1>(0, 3));
      const Eigen::Vector2d pixel = project(camera, in_camera);
      CHECK(pixel.x() == doctest::Approx(x + 0.5).epsilon(1e-4));
      CHECK(pixel.y() == doctest::Approx(y + 0.5).epsilon(1e-4));
    }
}

TEST_CASE("a contracted scene is centred where the cameras look") {
  Scene scene;
  const Eigen::Vector3d focus(3, -1, 2);
  for (int i = 0; i < 8; i++) {
    const double angle = 0.7 * i;
    Frame frame;
    const Eigen::Vector3d origin =
        focus + 2.5 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.3 * std::sin(2 * angle)).normalized();
    const Eigen::Vector3d forward = (focus - origin).normalized(),
                          right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
    frame.world_from_camera.block<3, 1>(0, 0) = right;
    frame.world_from_camera.block<3, 1>(0, 1) = forward.cross(right);
    frame.world_from_camera.block<3, 1>(0, 2) = forward;
    frame.world_from_camera.block<3, 1>(0, 3) = origin;
    scene.frames.push_back(frame);
  }
  const SceneFrame frame = fit_scene(scene);
  CHECK(frame.contract);
  CHECK((frame.centre - focus).norm() < 1e-4);
  CHECK(frame.scale == doctest::Approx(1 / 2.5).epsilon(1e-4));
}

TEST_CASE("a checkpoint of another shape is refused with the names that do not fit") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {4, 1, 16, 1});
  const Scene scene = read_scene(folder.path / "data");
  const auto build = [&](const std::string& kind) {
    Settings settings = kSmallHash;
    settings.push_back({"field.kind", kind});
    auto method = configured("nerf", settings);
    method->build({scene}, 1);
    load_data(*method, scene, load_images(scene, Split::train));
    return method;
  };
  auto hash = build("hash");
  TrainOptions options;
  options.steps = 2;
  const TrainResult result = train({*hash, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  const SafetensorsFile file = read_safetensors(result.checkpoint);
  auto planes = build("triplane");
  CHECK_THROWS_WITH_AS(restore_method(*planes, file), doctest::Contains("missing: field.planes"), Error);
  auto again = build("hash");
  CHECK(restore_method(*again, file).step == 2);
}

TEST_CASE("nerf: an unknown pixel loss or background is named") {
  for (const auto& [key, value] : Settings{{"train.loss", "l1"}, {"background", "pink"}}) {
    const Settings settings = {{key, value}};
    CHECK_THROWS_WITH_AS(configured("nerf", settings), doctest::Contains((key + ": \"" + value).c_str()), Error);
  }
}
