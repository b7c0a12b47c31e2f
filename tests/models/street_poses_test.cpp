// Poses of a log's photos that are learned: samples that follow their rays, against float64; that disturbed poses come
// back; the log that is written.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "models/data/read_scene.h"
#include "models/data/refined_log.h"
#include "models/methods/camera_refinement.h"
#include "models/methods/registry.h"
#include "models/street/followed_rays.h"
#include "models/synth/street_log.h"
#include "models/train/refines_cameras.h"
#include "tests/models/learned_cameras.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

constexpr double kDegrees = 180 / M_PI;

Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Vector3d(normal(random), normal(random), normal(random)).normalized();
}

/// A street that is full of matter, the middle of which is not contracted, with one box that is turned and another.
struct FullStreet {
  const Vector3d centre{0.5, -0.25, 1}, half{4, 3, 1.5};
  StreetGrid grid;
  StreetBoxes boxes;
  std::vector<StreetBox> packed;

  FullStreet() {
    std::vector<float> numbers = {-9, -5, -1, 0.5f, 37, 21, 11};
    for (const Vector3d& of : {centre, half})
      for (int k = 0; k < 3; ++k) numbers.push_back(static_cast<float>(of[k]));
    numbers.resize(16, 500.f);
    grid = {from_host(std::vector<uint8_t>(37 * 21 * 11, 1), {11, 21, 37}),
            from_host(std::vector<uint8_t>(5 * 3 * 2, 1), {2, 3, 5}), from_host(numbers, {16})};
    for (const float owner : {3.f, 1.f}) {
      StreetBox box{{}, {2 - owner, owner, 0.5f}, {1, 1.5f, 0.75f}, 0.25f, owner};
      const Eigen::Matrix3f turn = Eigen::AngleAxisf(0.6f * owner, Eigen::Vector3f::UnitZ()).toRotationMatrix();
      Eigen::Map<Eigen::Matrix3f>(box.box_from_street.data()) = turn;  // columns of its transpose are rows
      packed.push_back(box);
    }
    // The second moment has the first box alone.
    boxes = pack_boxes({packed, {packed[0]}});
  }

  Vector3d contracted(const Vector3d& place) const {
    const Vector3d x = (place - centre).cwiseQuotient(half);
    const double norm = x.cwiseAbs().maxCoeff();
    const Vector3d folded = norm > 1 ? Vector3d((2 - 1 / norm) / norm * x) : x;
    return 0.25 * folded + Vector3d::Constant(0.5);
  }
  /// In the cube of an owner.
  Vector3d in_cube(const Vector3d& place, int owner) const {
    const StreetBox& box = packed[owner == 3 ? 0 : 1];
    const Eigen::Matrix3f axes = Eigen::Map<const Eigen::Matrix3f>(box.box_from_street.data()).transpose();
    const Vector3d at(place - Eigen::Map<const Eigen::Vector3f>(box.centre.data()).cast<double>());
    return axes.cast<double>() * at * double{box.cube_scale} + Vector3d::Constant(0.5);
  }
};

/// Three numbers of each row.
Vector3d row_of(const std::vector<float>& rows, size_t i) {
  return Vector3d(rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]);
}

}  // namespace

TEST_CASE("samples that follow their rays lie where they were, and move as the rays do") {
  const FullStreet street;
  constexpr int64_t kRays = 12;
  std::mt19937 random(3);
  std::vector<float> origins, directions;
  for (int64_t r = 0; r < kRays; ++r) {
    const Vector3d from = 0.1 * random_direction(random);
    const Vector3d way = (Vector3d(r % 2 ? 1 : -1, 1.5, 0) + 0.6 * random_direction(random)).normalized();
    for (int k = 0; k < 3; ++k) {
      origins.push_back(static_cast<float>(from[k]));
      directions.push_back(static_cast<float>(way[k]));
    }
  }
  std::vector<int32_t> moments(kRays, 0);
  std::fill(moments.begin() + kRays / 2, moments.end(), 1);
  const StreetRays rays = {parameter(origins, {kRays, 3}), parameter(directions, {kRays, 3}), full({kRays, 2}, 0.4f),
                           from_host(moments, {kRays})};
  const StreetSamples given = street_samples(rays, street.boxes, street.grid, {.background = 0.6f, .actor = 0.2f});
  const StreetSamples found = followed(given, rays, street.boxes, street.grid);
  const std::vector<float> points = given.points.to_host(), followed_points = found.points.to_host();
  for (size_t i = 0; i < points.size(); ++i) CHECK(std::abs(points[i] - followed_points[i]) < 1e-5);
  const std::vector<float> actors = given.actor_points.to_host(), followed_actors = found.actor_points.to_host(),
                           ways = given.actor_directions.to_host(), followed_ways = found.actor_directions.to_host();
  REQUIRE(actors.size() > 60);
  for (size_t i = 0; i < actors.size(); ++i) {
    CHECK(std::abs(actors[i] - followed_actors[i]) < 1e-5);
    CHECK(std::abs(ways[i] - followed_ways[i]) < 1e-5);
  }

  // A sum over the samples, each coordinate with a weight of its own, and what of it goes along a change of the rays.
  const auto weight = [](size_t i) { return std::sin(1.7 * static_cast<double>(i)); };
  std::vector<float> weights(points.size()), actor_weights(actors.size());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(weight(i));
  for (size_t i = 0; i < actor_weights.size(); ++i) actor_weights[i] = static_cast<float>(weight(i));
  const Tensor total = sum(found.points * from_host(weights, found.points.shape())) +
                       sum(found.actor_points * from_host(actor_weights, found.actor_points.shape()));
  const Tensors gradients = grad(total, {rays.origins, rays.directions});
  const std::vector<float> by_origin = gradients[0].to_host(), by_direction = gradients[1].to_host();

  const std::vector<int32_t> offsets = given.offsets.to_host<int32_t>(), rows = given.rows.to_host<int32_t>(),
                             owners = given.owners.to_host<int32_t>();
  const std::vector<float> t = given.t.to_host();
  const auto background = static_cast<int32_t>(points.size() / 3);
  for (size_t r = 0; r < kRays; ++r) {
    const Vector3d from = row_of(origins, r), way = row_of(directions, r);
    const auto summed = [&](const Vector3d& origin, const Vector3d& direction) {
      double out = 0;
      const auto begin = static_cast<size_t>(offsets[r]), end = static_cast<size_t>(offsets[r + 1]);
      for (size_t place = begin; place < end; ++place) {
        const int32_t row = rows[place];
        const auto own = static_cast<size_t>(row < background ? row : row - background);
        double distance = t[place];
        if (distance < 0) {  // the sky: by even steps of 1 / distance from the edge that t tells to 500 m
          const double edge = -distance, share = (static_cast<double>(place - (end - 8)) + 0.4) / 8;
          distance = 1 / ((1 - share) / edge + share / 500);
        }
        const Vector3d at = origin + distance * direction;
        const Vector3d point = row < background ? street.contracted(at) : street.in_cube(at, owners[own]);
        for (size_t k = 0; k < 3; ++k) out += weight(3 * own + k) * point[static_cast<Eigen::Index>(k)];
      }
      return out;
    };
    for (int k = 0; k < 3; ++k) {
      const Vector3d by = 1e-6 * Vector3d::Unit(k);
      const auto i = 3 * r + static_cast<size_t>(k);
      const double want = (summed(from + by, way) - summed(from - by, way)) / 2e-6,
                   want_way = (summed(from, way + by) - summed(from, way - by)) / 2e-6;
      CHECK(std::abs(by_origin[i] - want) < 1e-3 * std::max(1., std::abs(want)));
      CHECK(std::abs(by_direction[i] - want_way) < 1e-3 * std::max(1., std::abs(want_way)));
    }
  }
}

namespace {

/// The log with each photo turned by a degree and shifted by 0.1 m.
Scene disturbed(Scene log) {
  std::mt19937 random(5);
  for (Frame& frame : log.frames) {
    Eigen::Matrix4d by = Eigen::Matrix4d::Identity();
    by.topLeftCorner<3, 3>() = Eigen::AngleAxisd(1 / kDegrees, random_direction(random)).toRotationMatrix();
    by.topRightCorner<3, 1>() = 0.1 * random_direction(random);
    frame.world_from_camera = frame.world_from_camera * by;
  }
  return log;
}

/// Means over photos: degrees, metres.
std::pair<double, double> errors_of(const std::vector<Eigen::Matrix4d>& poses, const Scene& truth) {
  double degrees = 0, metres = 0;
  for (size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Matrix4d by = truth.frames[i].world_from_camera.inverse() * poses[i];
    degrees += Eigen::AngleAxisd(Eigen::Matrix3d(by.topLeftCorner<3, 3>())).angle() * kDegrees;
    metres += by.topRightCorner<3, 1>().norm();
  }
  const auto count = static_cast<double>(poses.size());
  return {degrees / count, metres / count};
}

std::vector<Eigen::Matrix4d> poses_of(const Scene& scene) {
  std::vector<Eigen::Matrix4d> out;
  for (const Frame& frame : scene.frames) out.push_back(frame.world_from_camera);
  return out;
}

}  // namespace

TEST_CASE(
    "rays of a log's photos begin and go where their cameras were learned to stand and see, those of LiDAR stay") {
  const Folder folder;
  Scene log = toy_street(folder.path, {.frames = 3});
  log.cameras.push_back(log.cameras[0]);
  log.frames[0].split = Split::test;
  log.frames[2].camera = 1;
  Eigen::Matrix4d log_from_world = Eigen::Matrix4d::Identity();
  log_from_world.topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.4, Vector3d(1, -2, 2) / 3).toRotationMatrix();
  log_from_world.topRightCorner<3, 1>() = Vector3d(3, -1, 2);
  LogCameras cameras;
  Params parameters;
  cameras.build({{.refine = true}, {.refine = true, .centres = true}}, log, log_from_world, parameters, "log0.");
  // A shift brings a turn along that keeps in place what is 15 m away; shifts are in units of 5 m.
  const Vector3d turn(0.02, -0.03, 0.05), shift(0.04, 0.06, -0.05), along(shift.y() / 3, -shift.x() / 3, 0);
  const double factor = 1.1;
  const Eigen::Vector2d centre(0.03, -0.04);
  const auto second_row = [&](const Vector3d& values) {
    return from_host(std::vector<float>{0, 0, 0, static_cast<float>(values.x()), static_cast<float>(values.y()),
                                        static_cast<float>(values.z())},
                     {2, 3});
  };
  assign(
      {{parameters.at("log0.poses.turns"), second_row(turn)},
       {parameters.at("log0.poses.shifts"), second_row(shift)},
       {parameters.at("log0.intrinsics.log_focals"),
        from_host(std::vector<float>{0, static_cast<float>(std::log(factor))}, {2, 1})},
       {parameters.at("log0.intrinsics.centres"),
        from_host(std::vector<float>{0, 0, static_cast<float>(centre.x()), static_cast<float>(centre.y())}, {2, 2})}});
  const Vector3d whole = turn + along;
  Eigen::Matrix4d move = Eigen::Matrix4d::Identity();
  move.topLeftCorner<3, 3>() =
      Eigen::AngleAxisd(2 * std::atan(whole.norm() / 2), whole.normalized()).toRotationMatrix();
  move.topRightCorner<3, 1>() = 5 * shift;
  CHECK((cameras.learned().poses()[1] - log.frames[2].world_from_camera * move).norm() < 1e-5);
  const LensChange lens = cameras.learned().lens_changes()[1];
  CHECK(lens.focal == doctest::Approx(factor));
  CHECK((lens.centre - centre).norm() < 1e-6);

  // One ray from beside each camera, in its axes, and one of the LiDAR.
  const Vector3d place(0.1, -0.2, 0.3), way = Vector3d(0.4, -0.3, 1).normalized();
  RayList rays;
  rays.times = {0};
  for (const size_t i : {1, 2}) {
    const Frame& frame = log.frames[i];
    const Eigen::Matrix4d log_from_camera = log_from_world * frame.world_from_camera;
    rays.add((log_from_camera * place.homogeneous()).head<3>(), log_from_camera.topLeftCorner<3, 3>() * way);
  }
  rays.add({1, 2, 3}, {0.6, 0, 0.8});
  const RaysInStreet seen = cameras.moved(rays, {{1, 1}, {2, 1}});
  const std::vector<float> origins = seen.origins.to_host(), directions = seen.directions.to_host();
  const Eigen::Matrix4d learned = log_from_world * log.frames[2].world_from_camera * move;
  const Vector3d narrow =
      Vector3d((way.x() - centre.x() * way.z()) / factor, (way.y() - centre.y() * way.z()) / factor, way.z())
          .normalized();
  CHECK((row_of(origins, 1) - (learned * place.homogeneous()).head<3>()).norm() < 1e-5);
  CHECK((row_of(directions, 1) - learned.topLeftCorner<3, 3>() * narrow).norm() < 1e-5);
  for (const size_t ray : {0, 2}) {
    CHECK((row_of(origins, ray) - row_of(rays.origins, ray)).norm() < 1e-5);
    CHECK((row_of(directions, ray) - row_of(rays.directions, ray)).norm() < 1e-6);
  }
}

namespace {

/// Photos that are shown by a field that is known, their poses disturbed, and how far those come back.
void check_turns_come_back(const std::string& name, Settings settings, const std::string& prefix, int64_t steps) {
  const Folder folder;
  Scene street = toy_street(folder.path, {.frames = 3, .width = 64, .height = 48});
  // Things at several distances: what tells a shift from a turn.
  street.actors = {toy_actor("a", {2, 4, 4}, 7, -2.5), toy_actor("b", {2, 3, 3}, 12, 3),
                   toy_actor("c", {2, 3, 6}, 18, 0)};
  settings.insert(settings.end(), {{"poses.refine", "true"}, {"poses.rate", "3e-3"}, {"poses.warm_up", "0"}});
  const auto model = configured(name, settings);
  model->build({street}, 7);
  load_data(*model, street, toy_pixels(street));
  make_painted(*model);
  const Scene begun = disturbed(street);
  const auto method = configured(name, settings);
  method->build({begun}, 7);
  load_data(*method, begun, painted(toy_pixels(street), *model, street));
  learn_alone(*method, prefix + "poses.", *model, steps);
  const auto [degrees, metres] = errors_of(poses_of(begun), street);
  const auto [degrees_left, metres_left] = errors_of(as<RefinesCameras>(*method)->refined_poses(0), street);
  MESSAGE(degrees, " degrees and ", metres, " m before, ", degrees_left, " and ", metres_left, " after");
  CHECK(degrees_left < 0.4 * degrees);
  CHECK(metres_left < 2 * metres);  // about a pixel: shifts do not come back, but they do not run away
}

}  // namespace

TEST_CASE("neurad: turns of photos come to where they show what the field shows") {
  check_turns_come_back("neurad", painted_neurad(), "", 250);
}

TEST_CASE("genassets: turns of photos come to where they show what the field shows, from patches and whole images") {
  check_turns_come_back("genassets", painted_planes({}), "log0.", 250);
  check_turns_come_back("genassets", painted_planes({{"batch.whole_images", "true"}}), "log0.", 250);
}

TEST_CASE("genassets: LiDAR's rays stay where they are when the cameras move, those of patches and objects do not") {
  const Folder folder;
  Scene street = toy_street(folder.path, {.frames = 3, .width = 64, .height = 48});
  street.actors = {toy_actor("a", {2, 4, 4}, 7, -2.5), toy_actor("b", {2, 3, 3}, 12, 3)};
  const auto method = configured("genassets", painted_planes({{"poses.refine", "true"},
                                                              {"batch.lidar_rays", "32"},
                                                              {"batch.objects", "1"},
                                                              {"weight.perceptual", "0.1"}}));
  method->build({street}, 7);
  load_data(*method, street, toy_pixels(street));
  make_painted(*method);
  const auto figures = [&] {
    const Step step = method->step({4, 10, 7, {}}, {});
    std::map<std::string, double> out = {{"loss", double{step.loss.item()}}};
    for (const Figure& figure : step.figures) out[figure.name] = figure.value();
    return out;
  };
  const auto before = figures();
  put(*method, "log0.poses.shifts", std::vector<float>(9, 0.1f));  // half a metre along each axis
  const auto after = figures();
  CHECK(after.at("lidar_m") == doctest::Approx(before.at("lidar_m")).epsilon(1e-4));
  CHECK(before.at("lidar_m") > 0);
  CHECK(before.at("lidar_m") < 1);
  CHECK(std::abs(after.at("loss") - before.at("loss")) > 1e-3 * before.at("loss"));
}

TEST_CASE("a log is written with learned poses of its photos, and read with them") {
  const Folder folder;
  StreetLogOptions options;
  options.cameras = {"front_camera", "front_left_camera"};
  options.frames = 2, options.width = 32, options.height = 18, options.beams = 4;
  write_street_log(folder.path / "given", options);
  const Scene given = read_scene(folder.path / "given");
  const Scene learned = disturbed(given);
  RefinedLog refined;
  refined.lenses["front_left_camera"] = {1.25, {0.1, -0.05}};
  for (const Frame& frame : learned.frames)
    if (frame.step == 1 || frame.sensor == "front_camera") refined.poses[frame.name] = frame.world_from_camera;
  write_refined_log(folder.path / "refined", given, refined);
  const Scene again = read_scene(folder.path / "refined");
  REQUIRE(again.frames.size() == 4);
  REQUIRE(refined.poses.size() == 3);
  for (size_t i = 0; i < again.frames.size(); ++i) {
    const auto found = refined.poses.find(again.frames[i].name);
    const Eigen::Matrix4d& want = found == refined.poses.end() ? given.frames[i].world_from_camera : found->second;
    CHECK((again.frames[i].world_from_camera - want).norm() < 1e-9);
    const auto camera_of = [&](const Scene& scene) {
      return scene.cameras[static_cast<size_t>(scene.frames[i].camera)];
    };
    const Camera was = camera_of(given), is = camera_of(again);
    const bool changed = again.frames[i].sensor == "front_left_camera";
    CHECK(is.fx == doctest::Approx(changed ? 1.25 * was.fx : was.fx));
    CHECK(is.fy == doctest::Approx(changed ? 1.25 * was.fy : was.fy));
    CHECK(is.cx == doctest::Approx(changed ? was.cx + 0.1 * was.fx : was.cx));
    CHECK(is.cy == doctest::Approx(changed ? was.cy - 0.05 * was.fy : was.cy));
  }
  CHECK((again.sweeps[1].world_from_lidar - given.sweeps[1].world_from_lidar).norm() < 1e-12);
}
