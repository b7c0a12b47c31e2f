// Poses that are learned: where they put photos, by float64; their gradients, by differences; that disturbed ones come
// back.
#include "models/methods/pose_refinement.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <numeric>
#include <random>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/data/write_transforms.h"
#include "models/render/rays.h"
#include "models/splat/draw.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/optimiser.h"
#include "models/train/refines_cameras.h"
#include "models/train/trainer.h"
#include "runtime/error.h"
#include "tests/models/folder.h"
#include "tests/models/learned_cameras.h"

using namespace cloam;

namespace {

constexpr double kDegrees = 180 / M_PI;

Eigen::Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

Eigen::Matrix4d motion(const Eigen::Vector3d& axis, double angle, const Eigen::Vector3d& shift) {
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  out.topRightCorner<3, 1>() = shift;
  return out;
}

/// The poses in the axes of the true ones: a scene may be learned turned and shifted as a whole.
std::vector<Eigen::Matrix4d> aligned(std::vector<Eigen::Matrix4d> poses, const std::vector<Eigen::Matrix4d>& truth) {
  Eigen::Matrix3Xd from(3, poses.size()), to(3, poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = poses[i].topRightCorner<3, 1>();
    to.col(static_cast<Eigen::Index>(i)) = truth[i].topRightCorner<3, 1>();
  }
  const Eigen::Matrix4d similarity = Eigen::umeyama(from, to);
  const double scale = std::cbrt(similarity.topLeftCorner<3, 3>().determinant());
  for (Eigen::Matrix4d& pose : poses) {
    pose = similarity * pose;
    pose.topLeftCorner<3, 3>() /= scale;
  }
  return poses;
}

/// Means over photos: degrees, and the distance from the true place.
struct Errors {
  double degrees = 0, distance = 0;
};

Errors errors_of(const std::vector<Eigen::Matrix4d>& poses, const std::vector<Eigen::Matrix4d>& truth) {
  Errors out;
  for (size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Matrix3d turn = (truth[i].inverse() * poses[i]).topLeftCorner<3, 3>();
    out.degrees += Eigen::AngleAxisd(turn).angle() * kDegrees / static_cast<double>(poses.size());
    out.distance += (truth[i] - poses[i]).topRightCorner<3, 1>().norm() / static_cast<double>(poses.size());
  }
  return out;
}

Scene made_scene(const Folder& folder, int side, int photos = 20) {
  write_synthetic_scene(folder.path / "data", {photos, 2, side, 3});
  return read_scene(folder.path / "data");
}

std::vector<Eigen::Matrix4d> training_poses(const Scene& scene) {
  std::vector<Eigen::Matrix4d> out;
  for (const size_t frame : frames_of(scene, Split::train)) out.push_back(scene.frames[frame].world_from_camera);
  return out;
}

/// What a camera at `want` sees of the world and of a thing in it, from views of the pose that was given.
void check_moved_views(const Eigen::Matrix4d& given, const Eigen::Matrix4d& want, const ViewMove& move) {
  const Eigen::Matrix4d nothing = Eigen::Matrix4d::Identity(),
                        thing = motion(Eigen::Vector3d(1, 2, -2) / 3, 0.7, {0.3, -0.2, 0.5});
  const Tensor views =
      concat({reshape(view_matrix(given), {1, 3, 4}), reshape(view_matrix(thing.inverse() * given), {1, 3, 4})}, 0);
  const MovedViews seen = moved(views, move);
  const std::vector<float> rows = seen.views.to_host(), eyes = seen.eyes.to_host();
  for (const size_t i : {0, 1}) {
    const Eigen::Matrix4d thing_from_camera = (i == 0 ? nothing : thing).inverse() * want,
                          camera_from_thing = thing_from_camera.inverse();
    for (int row = 0; row < 3; ++row) {
      CHECK(std::abs(double{eyes[3 * i + static_cast<size_t>(row)]} - thing_from_camera(row, 3)) < 1e-4);
      for (int column = 0; column < 4; ++column)
        CHECK(std::abs(double{rows[12 * i + static_cast<size_t>(4 * row + column)]} - camera_from_thing(row, column)) <
              1e-4);
    }
  }
}

}  // namespace

TEST_CASE("poses: a turn and a shift in the camera's axes are the same for poses, for views and as they are told") {
  const Folder folder;
  const Scene scene = made_scene(folder, 8);
  const std::vector<Eigen::Matrix4d> given = training_poses(scene);
  PoseRefinement poses;
  Params parameters;
  poses.build({.refine = true}, scene, parameters);
  const double unit = viewing_distance(scene), scale = 0.25;
  std::mt19937 random(4);
  std::vector<float> turns, shifts;
  std::vector<Eigen::Matrix4d> want;
  for (const Eigen::Matrix4d& pose : given) {
    const Eigen::Vector3d axis = random_direction(random), shift = random_direction(random);
    const double angle = 0.4;
    const Eigen::Vector3d turn = 2 * std::tan(angle / 2) * axis - Eigen::Vector3d(shift.y(), -shift.x(), 0);
    for (int i = 0; i < 3; ++i) {
      turns.push_back(static_cast<float>(turn[i]));
      shifts.push_back(static_cast<float>(shift[i]));
    }
    want.push_back(pose * motion(axis, angle, unit * shift));
  }
  const auto count = static_cast<int64_t>(given.size());
  assign({{parameters.at("poses.turns"), from_host(turns, {count, 3})},
          {parameters.at("poses.shifts"), from_host(shifts, {count, 3})}});

  const std::vector<Eigen::Matrix4d> told = poses.poses();
  SceneFrame frame;
  frame.scale = scale;
  frame.turn = Eigen::AngleAxisd(1, random_direction(random)).toRotationMatrix();
  frame.centre = {1, 2, 3};
  std::vector<float> rows, wanted;
  for (size_t i = 0; i < given.size(); ++i) {
    CHECK((told[i] - want[i]).norm() < 1e-5);
    append_pose(rows, given[i], frame);
    append_pose(wanted, want[i], frame);
    check_moved_views(given[i], want[i], poses.move_of(i));
  }
  const std::vector<float> there = poses.moved(from_host(rows, {count, 12}), scale).to_host();
  for (size_t i = 0; i < there.size(); ++i) CHECK(there[i] == doctest::Approx(wanted[i]).epsilon(1e-4));
}

namespace {

/// The gradient of a step's loss in the parameters of the poses, against differences along it.
void check_pose_gradients(const std::string& which, const Settings& settings) {
  const Folder folder;
  Scene scene = made_scene(folder, 16);
  scene.hints.synthetic_bounds = false;  // rays that end at a box would move their samples with it
  const auto method = configured(which, settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train));
  // Hash grids begin so small that places say nothing.
  if (const auto grid = method->parameters().find("field.grid.table"); grid != method->parameters().end()) {
    std::vector<float> rows(static_cast<size_t>(grid->second.numel()));
    for (size_t i = 0; i < rows.size(); ++i) rows[i] = 2 * std::sin(static_cast<float>(i));
    put(*method, grid->first, rows);
  }
  const Progress progress{1, 10, 7, {}};
  for (const char* name : {"poses.turns", "poses.shifts", "intrinsics.log_focals", "intrinsics.centres"}) {
    CAPTURE(name);
    const Tensor& parameter = method->parameters().at(name);
    const Step step = method->step(progress, {parameter});
    const std::vector<float> gradient = step.gradients.front().to_host();
    double told = 0;
    for (const float g : gradient) told += double{g} * double{g};
    REQUIRE(told > 0);
    // Along the gradient: the difference is its squared length times the step.
    const float by = 1e-3f / static_cast<float>(std::sqrt(told));
    const auto loss_at = [&](float way) {
      std::vector<float> values(gradient.size());
      for (size_t i = 0; i < values.size(); ++i) values[i] = way * by * gradient[i];
      put(*method, name, values);
      return double{method->step(progress, {}).loss.item()};
    };
    const double found = (loss_at(1) - loss_at(-1)) / (2 * double{by});
    put(*method, name, std::vector<float>(gradient.size(), 0.f));
    CHECK(std::abs(found / told - 1) < 0.05);
  }
}

}  // namespace

TEST_CASE("nerf: the loss falls as the gradient in poses and lenses says") {
  check_pose_gradients("nerf", {{"poses.refine", "true"},
                                {"intrinsics.refine", "true"},
                                {"intrinsics.centres", "true"},
                                {"field.kind", "frequency"},
                                {"field.width", "16"},
                                {"field.depth", "2"},
                                {"field.point_frequencies", "2"},
                                {"field.direction_frequencies", "1"},
                                {"sampling", "uniform"},
                                {"samples.coarse", "8"},
                                {"batch.rays", "64"},
                                {"background", "white"}});
}

TEST_CASE("zipnerf: the loss falls as the gradient in poses and lenses says") {
  check_pose_gradients("zipnerf", {{"poses.refine", "true"},
                                   {"intrinsics.refine", "true"},
                                   {"intrinsics.centres", "true"},
                                   {"grid.levels", "1"},
                                   {"grid.log2_rows", "8"},
                                   {"weight.decay", "0"},
                                   {"grid.coarsest", "4"},
                                   {"grid.finest", "4"},
                                   {"field.width", "16"},
                                   {"batch.rays", "64"},
                                   {"background", "white"}});
}

namespace {

/// The scene with each training photo turned by a degree and shifted by a hundredth of its distance.
Scene disturbed(Scene scene) {
  std::mt19937 random(5);
  const double shift = 0.01 * viewing_distance(scene);
  for (const size_t frame : frames_of(scene, Split::train)) {
    Eigen::Matrix4d& pose = scene.frames[frame].world_from_camera;
    pose = pose * motion(random_direction(random), 1 / kDegrees, shift * random_direction(random));
  }
  return scene;
}

std::unique_ptr<Method> trained(const Scene& scene, const std::string& name, const Settings& settings, int64_t steps) {
  const Folder folder;
  auto method = configured(name, settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train));
  TrainOptions options;
  options.steps = steps;
  train({*method, folder.path, {}, nullptr, nullptr}, options, {});
  return method;
}

}  // namespace

namespace {

/// Of the shares of turns and shifts that are left of what the poses were disturbed by, the most that there may be.
struct Left {
  double turns, shifts;
};

void check_poses_come_back(const std::string& name, Settings settings, int64_t steps, const Left& most) {
  const Folder folder;
  const Scene scene = made_scene(folder, 64);
  const std::vector<Eigen::Matrix4d> truth = training_poses(scene);
  settings.emplace_back("poses.refine", "true");
  const auto method = trained(disturbed(scene), name, settings, steps);
  const Errors before = errors_of(aligned(training_poses(disturbed(scene)), truth), truth);
  const Errors after = errors_of(aligned(as<RefinesCameras>(*method)->refined_poses(0), truth), truth);
  MESSAGE(before.degrees, " degrees and ", before.distance, " before, ", after.degrees, " and ", after.distance,
          " after");
  CHECK(after.degrees < most.turns * before.degrees);
  CHECK(after.distance < most.shifts * before.distance);
}

}  // namespace

TEST_CASE("nerf: disturbed poses come back while the scene is learned") {
  check_poses_come_back("nerf", small_hash(), 600, {0.5, 0.7});
}

TEST_CASE("zipnerf: disturbed poses come back while the scene is learned") {
  check_poses_come_back("zipnerf",
                        {{"grid.levels", "6"},
                         {"grid.log2_rows", "13"},
                         {"grid.finest", "128"},
                         {"field.width", "32"},
                         {"field.bottleneck", "8"},
                         {"field.colour_width", "16"},
                         {"field.density", "exp"},
                         {"proposal1.levels", "3"},
                         {"proposal1.finest", "32"},
                         {"proposal2.levels", "3"},
                         {"proposal2.finest", "64"},
                         {"proposals.log2_rows", "12"},
                         {"proposals.width", "16"},
                         {"samples.proposal", "16"},
                         {"samples.field", "16"},
                         {"sampling.multisamples", "1"},
                         {"batch.rays", "512"},
                         {"train.warm_up", "30"}},
                        600, {0.6, 0.8});
}

TEST_CASE("splat: poses come to where the photos show what the gaussians show") {
  const Folder folder;
  // Few photos, each of which is seen by many steps.
  const Scene scene = made_scene(folder, 48, 4), begun = disturbed(scene);
  const std::vector<Eigen::Matrix4d> truth = training_poses(scene);
  const Settings settings = {{"initial", "random"},      {"initial.random", "400"}, {"background", "white"},
                             {"growth.start", "100000"}, {"poses.refine", "true"},  {"poses.rate", "4e-3"},
                             {"poses.warm_up", "0"}};
  const auto model = configured("splat", settings);
  model->build({scene}, 7);
  make_sharp(*model);
  const auto method = configured("splat", settings);
  method->build({begun}, 7);
  load_data(*method, begun, painted(load_images(scene, Split::train), *model, scene));
  learn_alone(*method, "poses.", *model, 600);
  const Errors before = errors_of(training_poses(begun), truth);
  const Errors after = errors_of(as<RefinesCameras>(*method)->refined_poses(0), truth);
  MESSAGE(before.degrees, " degrees and ", before.distance, " before, ", after.degrees, " and ", after.distance,
          " after");
  CHECK(after.degrees < 0.2 * before.degrees);
  CHECK(after.distance < 0.2 * before.distance);
}

TEST_CASE("a capture that was written is read with the same cameras, poses, splits, images and points") {
  const Folder folder;
  Scene scene = made_scene(folder, 12);
  scene.cloud = {{0, 1.5f, -2, 0.25f, 3e-6f, 7}, {0, 128, 255, 3, 2, 1}};
  write_transforms(folder.path / "again", scene);
  const Scene again = read_scene(folder.path / "again");
  CHECK(again.hints.synthetic_bounds == scene.hints.synthetic_bounds);
  CHECK(again.cloud.positions == scene.cloud.positions);
  CHECK(again.cloud.colours == scene.cloud.colours);
  for (const Split split : {Split::train, Split::test}) {
    const std::vector<size_t> was = frames_of(scene, split), is = frames_of(again, split);
    REQUIRE(was.size() == is.size());
    const Pixels before = load_images(scene, split), after = load_images(again, split);
    for (size_t i = 0; i < was.size(); ++i) {
      const Frame &a = scene.frames[was[i]], &b = again.frames[is[i]];
      CHECK((a.world_from_camera - b.world_from_camera).norm() < 1e-12);
      CHECK(scene.cameras[static_cast<size_t>(a.camera)] == again.cameras[static_cast<size_t>(b.camera)]);
      CHECK(before.frames[i].rgba == after.frames[i].rgba);
    }
  }
  Scene odd = scene;
  odd.cameras.front().model = CameraModel::fov;
  CHECK_THROWS_AS(write_transforms(folder.path / "odd", odd), Error);
  CHECK(!std::filesystem::exists(folder.path / "odd"));
}
