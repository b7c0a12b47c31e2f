// Street Gaussians against what is known otherwise: gaussians moved on the host, a wall, boxes, a log made for the
// test.
#include "models/methods/street_gaussians.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/tensors.h"
#include "models/methods/street_gaussians_renderer.h"
#include "models/scene/pose.h"
#include "models/splat/parameters.h"
#include "models/street/photo_hints.h"
#include "models/train/trainer.h"
#include "tests/models/made_method.h"
#include "tests/models/resume.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// `count` gaussians about the origin, each a colour of its own that changes with the direction.
Gaussians cluster(uint64_t seed, int count) {
  HostRandom random(seed);
  Gaussians g;
  const auto some = [&](std::vector<float>& to, int numbers, double low, double high) {
    for (int i = 0; i < numbers; ++i) to.push_back(static_cast<float>(random.between(low, high)));
  };
  for (int i = 0; i < count; ++i) {
    some(g.means, 3, -1, 1);
    some(g.scales, 3, -3, -1);
    some(g.rotations, 4, 0.2, 1);
    some(g.opacities, 1, -1, 2);
    some(g.sh_first, 3, -1, 1);
    some(g.sh_rest, 45, -0.3, 0.3);
  }
  return g;
}

double largest_difference(const Tensor& a, const Tensor& b) {
  const std::vector<float> x = a.to_host(), y = b.to_host();
  REQUIRE(x.size() == y.size());
  double most = 0;
  for (size_t i = 0; i < x.size(); ++i) most = std::max(most, std::abs(double{x[i]} - double{y[i]}));
  return most;
}

Settings tiny() {
  return {{"initial.lidar", "300"}, {"initial.near", "20"}, {"initial.far", "20"}, {"initial.actor", "40"},
          {"initial.fewest", "40"}, {"sky.side", "4"},      {"growth.start", "0"}};
}

/// A toy log with two actors.
Scene two_actors(const std::filesystem::path& root, const ToyOptions& options = {}) {
  Scene scene = toy_street(root, options);
  scene.actors = {toy_actor("a", {2, 4, 1.5}, 12, 2), toy_actor("b", {2, 4, 1.5}, 12, -2)};
  return scene;
}

std::unique_ptr<Method> built(const Scene& scene, const Settings& more = {}) {
  Settings settings = tiny();
  settings.insert(settings.end(), more.begin(), more.end());
  auto method = configured("street-gaussians", settings);
  method->build({scene}, 3);
  load_data(*method, scene, toy_pixels(scene));
  return method;
}

}  // namespace

TEST_CASE("gaussians of things are seen as if they had been moved to where the things stand") {
  const Camera camera = {80, 60, 70, 70, 40, 30};
  const Eigen::Matrix4d eye = pose_from(turn_about_z(0.3) * Eigen::AngleAxisd(0.2, Vector3d::UnitX()), {0.4, -0.2, -6});
  const std::vector<Eigen::Matrix4d> poses = {
      pose_from(Eigen::Matrix3d(Eigen::AngleAxisd(1.1, Vector3d(1, 2, 3).normalized())), {1, 0, 0.5}),
      pose_from(Eigen::Matrix3d(Eigen::AngleAxisd(-2.3, Vector3d(-1, 1, 0.2).normalized())), {-1.5, 0.3, 1})};
  const std::vector<std::vector<float>> out = {{0.5f, -1.f}, {-0.25f, 0.75f}};  // of the waves
  Gaussians own, moved;
  std::vector<int32_t> owners;
  std::vector<float> waves, stands, amplitudes;
  HostRandom random(9);
  for (size_t t = 0; t < poses.size(); ++t) {
    const Gaussians some = cluster(t + 1, 30);
    append(own, some);
    Gaussians there = some;
    for (size_t i = 0; i < some.count(); ++i)
      for (size_t wave = 0; wave < 2; ++wave)
        for (size_t c = 0; c < 3; ++c) {
          amplitudes.push_back(static_cast<float>(random.between(-0.5, 0.5)));
          there.sh_first[3 * i + c] += amplitudes.back() * out[t][wave];
        }
    transform(there, {poses[t].topLeftCorner<3, 3>(), 1, poses[t].topRightCorner<3, 1>()});
    append(moved, there);
    owners.insert(owners.end(), some.count(), static_cast<int32_t>(t));
    for (int k = 0; k < 12; ++k) stands.push_back(static_cast<float>(poses[t](k / 4, k % 4)));
    waves.insert(waves.end(), out[t].begin(), out[t].end());
  }
  const SplatModel inside = splat_model(own), world = splat_model(moved);
  const ThingsModel things = {inside, parameter(amplitudes, {60, 2, 3}), from_host(owners, {60})};
  const Tensor shifts = parameter(std::vector<float>(6, 0), {2, 3});  // a row each
  const Placements at = {{from_host(stands, {2, 3, 4}), shifts, zeros({2, 1}),
                          from_host(std::vector<int32_t>{0, 0, 1, 1}, {2, 2}), full({2, 2}, 0.5f), ones({2})},
                         from_host(waves, {2, 2})};
  const Projection found = projection_of(things, at, camera, view_matrix(eye), {}),
                   expected = projection_of(world, camera, view_matrix(eye), {});
  CHECK(largest_difference(found.seen, expected.seen) < 2e-3);  // pixels
  CHECK(largest_difference(found.rgb, expected.rgb) < 1e-4);
  // Both pictures ask the same of a gaussian's mean, but in other axes; of a shift, what its gaussians ask together.
  const auto picture_loss = [&](const Projection& seen) { return mean(square(draw(seen, camera, {}).planes)); };
  const Tensors by_own = grad(picture_loss(found), {inside.cloud.means, shifts});
  const std::vector<float> a = by_own[0].to_host(), p = by_own[1].to_host(),
                           b = grad(picture_loss(expected), {world.cloud.means})[0].to_host();
  std::vector<Vector3d> sums(2, Vector3d::Zero());
  double most = 0, worst = 0;
  for (size_t i = 0; i < 60; ++i) {
    const Vector3d in_world(b[3 * i], b[3 * i + 1], b[3 * i + 2]), in_box(a[3 * i], a[3 * i + 1], a[3 * i + 2]);
    const auto owner = static_cast<size_t>(owners[i]);
    sums[owner] += in_world;
    most = std::max(most, in_world.norm());
    worst = std::max(worst, (poses[owner].topLeftCorner<3, 3>() * in_box - in_world).norm());
  }
  CHECK(worst < 1e-3 * most);
  for (size_t t = 0; t < 2; ++t)
    CHECK((sums[t] - poses[t].topLeftCorner<3, 3>() * Vector3d(p[3 * t], p[3 * t + 1], p[3 * t + 2])).norm() <
          5e-3 * sums[t].norm());
}

TEST_CASE("LiDAR's returns in a photo: those on a car have gone with it, those that it hides are left out") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 1, .width = 320, .height = 240});
  Actor car = toy_actor("car", {2, 4, 1.5}, 12, 0);
  for (ActorBox& box : car.boxes) box.world_from_box = toy_pose(12 + 20 * box.timestamp, 0, 0.75);  // drives away
  scene.actors = {car};
  LidarPoints points;
  const auto add = [&](double x, double y, double z) {
    for (const double v : {x, y, z}) points.positions.push_back(static_cast<float>(v));
    points.intensities.push_back(0);
    points.times.push_back(0);
    points.sensors.push_back(0);
  };
  add(11, 0.3, 0.8);                                       // the car's back, before the photo
  for (double y = -3; y <= 3; y += 0.25) add(29, y, 0.8);  // far behind it
  scene.frames[0].timestamp = 0.2;                         // by then the car is 4 m further
  const PixelDepths seen = pixel_depths(scene, scene.frames[0], scene.cameras[0], scene.sweeps[0], points);
  const auto depth_at = [&](double x, double y, double z) {
    const Vector3d in_camera =
        (scene.frames[0].world_from_camera.inverse() * Vector3d(x, y, z).homogeneous()).head<3>();
    const Eigen::Vector2d at = project(scene.cameras[0], in_camera);
    const auto pixel = static_cast<int32_t>(at.y()) * 320 + static_cast<int32_t>(at.x());
    const auto found = std::find(seen.pixels.begin(), seen.pixels.end(), pixel);
    return found == seen.pixels.end() ? 0.0 : double{seen.depths[static_cast<size_t>(found - seen.pixels.begin())]};
  };
  CHECK(depth_at(15, 0.3, 0.8) == doctest::Approx(15));
  CHECK(depth_at(11, 0.3, 0.8) == 0);
  CHECK(depth_at(29, 3, 0.8) == doctest::Approx(29));
  // Of two that fall beside each other, the one that is seen through the other is gone.
  LidarPoints two;
  std::swap(points, two);
  add(10, 0.05, 1.5);
  add(29, 0.145, 1.5);
  const PixelDepths of_two = pixel_depths(scene, scene.frames[0], scene.cameras[0], scene.sweeps[0], points);
  REQUIRE(of_two.depths.size() == 1);
  CHECK(of_two.depths[0] == doctest::Approx(10));
}

TEST_CASE("pixels are of the sky where no ray meets what LiDAR saw, and may be actors' where boxes are") {
  const Folder folder;
  const Scene scene = two_actors(folder.path, {.frames = 1, .width = 64, .height = 96});
  StreetSpace space(scene, {});
  const LidarPoints points = load_sweep(scene, scene.sweeps[0]);
  space.look(scene, {{&scene.sweeps[0], points}});
  const Camera& camera = scene.cameras[0];
  const PixelDepths depths = pixel_depths(scene, scene.frames[0], camera, scene.sweeps[0], points);
  const std::vector<uint8_t> kinds = pixel_kinds(scene, scene.frames[0], camera, space, depths);
  const auto kind_at = [&](const Vector3d& place) {
    const Vector3d at = (scene.frames[0].world_from_camera.inverse() * place.homogeneous()).head<3>();
    const Eigen::Vector2d pixel = project(camera, at);
    REQUIRE((pixel.y() >= 0 && pixel.y() < camera.height));
    return kinds[static_cast<size_t>(pixel.y()) * 64 + static_cast<size_t>(pixel.x())];
  };
  CHECK(kind_at({30, 0, 20}) == 0);  // above the wall's highest return it may go on
  CHECK(kind_at({30, 0, 6}) == kMatterPixel);
  CHECK((kind_at({11, 2, 0.8}) & kActorPixel) == kActorPixel);
  CHECK((kind_at({30, 0, 4}) & kActorPixel) == 0);
  // Without the wall's upper half in the way of the sky.
  Scene low = scene;
  LidarPoints few;
  for (size_t i = 0; i < points.size(); ++i) {
    if (std::abs(points.positions[3 * i + 1]) > 2) continue;
    few.positions.insert(few.positions.end(), &points.positions[3 * i], &points.positions[3 * i] + 3);
    few.intensities.push_back(0);
    few.times.push_back(0);
    few.sensors.push_back(0);
  }
  StreetSpace narrow(low, {});
  narrow.look(low, {{&low.sweeps[0], few}});
  const std::vector<uint8_t> beside =
      pixel_kinds(low, low.frames[0], camera, narrow, pixel_depths(low, low.frames[0], camera, low.sweeps[0], few));
  const auto count = [&](const std::vector<uint8_t>& of, uint8_t kind) {
    return std::count_if(of.begin(), of.end(), [&](uint8_t k) { return (k & kind) == kind; });
  };
  CHECK(count(beside, kSkyPixel) > count(kinds, kSkyPixel) + 64);
  CHECK(count(beside, kSkyPixel | kMatterPixel) == 0);
}

TEST_CASE("a street begins with what LiDAR saw: the background in the world, actors in their boxes") {
  const Folder folder;
  Scene scene = two_actors(folder.path);
  scene.actors[0].boxes.resize(1);  // where it stands at the first sweep
  scene.actors[0].boxes[0].world_from_box = pose_from(turn_about_z(0.7), {12, 2, 0.75});
  std::vector<LidarPoints> sweeps;
  for (const Sweep& sweep : scene.sweeps) sweeps.push_back(load_sweep(scene, sweep));
  const std::vector<Vector3d> in_box = {{0.5, 1.9, 0.2}, {-0.9, -1.5, -0.3}, {0, 1, 0.7}};
  for (const Vector3d& p : in_box) {
    const Vector3d world = (scene.actors[0].boxes[0].world_from_box * p.homogeneous()).head<3>();
    for (int k = 0; k < 3; ++k) sweeps[0].positions.push_back(static_cast<float>(world[k]));
    sweeps[0].intensities.push_back(0);
    sweeps[0].times.push_back(0);
    sweeps[0].sensors.push_back(0);
  }
  const auto every = [&](const auto& visit) {
    for (size_t i = 0; i < sweeps.size(); ++i) visit(scene.sweeps[i], sweeps[i]);
  };
  StreetStartOptions options{100000, 0.15f, 30, 40, 1000, 20, 300000, 5};
  const StreetStart start = street_start(scene, every, options);
  // Both sweeps see the same wall, every return in a voxel of its own.
  const size_t wall = sweeps[1].size();
  CHECK(start.background.count() == wall + 30 + 40);
  for (size_t i = 0; i < wall; ++i) CHECK(start.background.means[3 * i] == static_cast<float>(kToyWall));
  CHECK(start.owners.size() == 40);
  CHECK(std::count(start.owners.begin(), start.owners.end(), 0) == 20);
  for (size_t i = 0; i < in_box.size(); ++i)
    for (size_t k = 0; k < 3; ++k)
      CHECK(start.actors.means[3 * i + k] == doctest::Approx(in_box[i][static_cast<Eigen::Index>(k)]).epsilon(1e-4));
  for (size_t i = 0; i < 40; ++i)
    for (size_t k = 0; k < 3; ++k)
      CHECK(std::abs(start.actors.means[3 * i + k]) <= scene.actors[0].size[static_cast<Eigen::Index>(k)] / 2);
  options.fewest = 2;
  options.actors = 4;  // the second actor has no points, and gets two
  CHECK(street_start(scene, every, options).owners == std::vector<int32_t>{0, 0, 1, 1});
  options.lidar = 1000;
  options.voxel = 2;
  CHECK(street_start(scene, every, options).background.count() == 21 * 7 + 70);
}

TEST_CASE("street-gaussians: LiDAR's rays end on a wall of gaussians, or on the actor before it") {
  const Folder folder;
  const Scene scene = two_actors(folder.path);
  StreetGaussiansConfig config;
  config.sky_side = 2;
  Params params;
  StreetGaussiansModel model(config, params, scene);
  StreetStart start;
  const auto plate = [](Gaussians& g, const Vector3d& at, double deviation) {
    Gaussians one = zero_gaussians(1, "test");
    for (size_t k = 0; k < 3; ++k) one.means[k] = static_cast<float>(at[static_cast<Eigen::Index>(k)]);
    one.scales = {-7, static_cast<float>(std::log(deviation)), static_cast<float>(std::log(deviation))};
    one.rotations = {1, 0, 0, 0};
    one.opacities = {8};
    append(g, one);
  };
  for (double y = -12; y <= 12; y += 0.4)
    for (double z = -4; z <= 9; z += 0.4) plate(start.background, {kToyWall, y, z}, 0.3);
  for (double y = -1; y <= 1; y += 0.2)
    for (double z = -0.6; z <= 0.6; z += 0.2) plate(start.actors, {-1, y, z}, 0.25);
  start.owners.assign(start.actors.count(), 1);  // "b", at y = -2
  model.put(start);
  WorldRays rays;
  std::vector<double> expected;
  std::vector<int> actors;
  const auto add = [&](const Vector3d& from, const Vector3d& to, int actor) {
    const Vector3d way = (to - from).normalized();
    for (int k = 0; k < 3; ++k) {
      rays.origins.push_back(static_cast<float>(from[k]));
      rays.directions.push_back(static_cast<float>(way[k]));
    }
    expected.push_back(actor < 0 ? 0 : (to - from).norm());
    actors.push_back(std::max(0, actor));
  };
  for (double y = -7; y <= 7; y += 0.7)
    for (double z = 3; z <= 7; z += 0.9) add({0, 0, 2}, {kToyWall, y, z}, 0);
  add({0, 0, 2}, {11, -2, 0.7}, 2);
  add({0, 0.5, 1.8}, {11, -2.5, 0.9}, 2);  // from a place of its own
  add({0, 0, 2}, {-10, 0, 2}, -1);         // where nothing is
  const LidarReturns found = returns_of(model, rays);
  for (size_t i = 0; i < expected.size(); ++i) {
    CAPTURE(i);
    CHECK(double{found.depths[i]} == doctest::Approx(expected[i]).epsilon(0.003));
    CHECK(found.actors[i] == actors[i]);
  }
  // The picture names the actor there, and whoever else wears its looks.
  const View view{scene.cameras[0], scene.frames[0].world_from_camera, 0, 0};
  const auto actor_at = [&](const Vector3d& place) {
    const Eigen::Vector2d at = project(view.camera, (view.world_from_camera.inverse() * place.homogeneous()).head<3>());
    return picture_of(model, view).actors[static_cast<size_t>(at.y()) * 32 + static_cast<size_t>(at.x())];
  };
  CHECK(actor_at({11, -2, 0.7}) == 2);
  CHECK(actor_at({11, 2, 0.7}) == 0);
  std::vector<Actor> dressed = scene.actors;
  dressed[0].asset = AssetName{0, "b"};
  model.take_actors(dressed);
  CHECK(actor_at({11, 2, 0.7}) == 1);
  CHECK(actor_at({11, -2, 0.7}) == 2);
}

TEST_CASE("street-gaussians: a checkpoint of any step holds all that the next step and a render read, growth and all") {
  const Folder folder;
  const Scene scene = two_actors(folder.path);
  const Settings growing = {{"growth.every", "3"},      {"growth.gradient", "1e-6"}, {"growth.reset_every", "9"},
                            {"batch.depth_every", "2"}, {"sh.every", "4"},           {"actors.max", "400"}};
  const Settings mcmc = {{"growth.strategy", "mcmc"}, {"growth.every", "3"}, {"growth.absolute", "true"}};
  for (const Settings& settings : {growing, mcmc}) {
    CAPTURE(settings[0].second);
    check_resumes_from_every_step({[&] { return built(scene, settings); },
                                   [&](Method& method) {
                                     std::vector<float> look =
                                         shown(method, view_of(scene.frames.front(), scene.cameras.front(), 0)).rgb;
                                     look.push_back(static_cast<float>(method.parameters().at("actors.means").dim(0)));
                                     return look;
                                   },
                                   14});
  }
}

TEST_CASE("street-gaussians: what grows of an actor is that actor's, in its box") {
  const Folder folder;
  Scene scene = two_actors(folder.path);
  scene.actors[1].size = {1, 1, 1};
  const auto method = built(scene, {{"growth.every", "2"}, {"growth.gradient", "0"}, {"batch.depth_every", "1"}});
  // The first actor's are red for good, the second's green.
  const auto owners = [&] {
    return integers_from(method->state(), "owners",
                         static_cast<size_t>(method->parameters().at("actors.means").dim(0)));
  };
  const auto paint = [&] {
    std::vector<float> first;
    for (const int64_t owner : owners())
      for (int c = 0; c < 3; ++c) first.push_back(c == owner ? 100.f : -100.f);
    put(*method, "actors.sh_first", first);
  };
  paint();
  const size_t before = owners().size();
  TrainOptions options;
  options.steps = 12;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  const std::vector<int64_t> after = owners();
  CHECK(after.size() > before + 20);
  const std::vector<float> colours = method->parameters().at("actors.sh_first").to_host(),
                           means = method->parameters().at("actors.means").to_host();
  for (size_t i = 0; i < after.size(); ++i) {
    CHECK((colours[3 * i] > 0) == (after[i] == 0));
    CHECK((colours[3 * i + 1] > 0) == (after[i] == 1));
  }
  CHECK(std::count(after.begin(), after.end(), 0) > 0);
  CHECK(std::count(after.begin(), after.end(), 1) > 0);
}

TEST_CASE("street-gaussians: a step with actors.flip sees actors as if their Gaussians lay mirrored in their boxes") {
  const Folder folder;
  const Scene scene = two_actors(folder.path);
  const auto plain = built(scene), flipped = built(scene, {{"actors.flip", "1"}});
  for (const char* name :
       {"poses.positions", "poses.yaws"}) {  // a box that was corrected is mirrored where it stands then
    std::vector<float> learned = plain->parameters().at(name).to_host();
    for (size_t i = 0; i < learned.size(); ++i) learned[i] = 0.1f * static_cast<float>(i % 3);
    for (Method* method : {plain.get(), flipped.get()}) put(*method, name, learned);
  }
  const auto loss = [](Method& method) { return double{method.step({1, 100, 1}, {}).loss.item()}; };
  const double mirrored = loss(*flipped), before = loss(*plain);
  std::vector<float> means = plain->parameters().at("actors.means").to_host(),
                     turns = plain->parameters().at("actors.rotations").to_host();
  for (size_t i = 0; i < means.size(); i += 3) means[i] = -means[i];
  for (size_t i = 0; i < turns.size(); i += 4) turns[i + 2] = -turns[i + 2], turns[i + 3] = -turns[i + 3];
  put(*plain, "actors.means", means);
  put(*plain, "actors.rotations", turns);
  CHECK(loss(*plain) == doctest::Approx(mirrored).epsilon(1e-5));
  CHECK(std::abs(before - mirrored) > 1e-4 * mirrored);
}

TEST_CASE("street-gaussians: cameras that take darker photos have an exposure of their own") {
  const Folder folder;
  Scene scene = two_actors(folder.path, {.frames = 4});
  Pixels photos = toy_pixels(scene);
  for (size_t i = 0; i < 4; ++i) {
    photos.frames[i].rgba = photos.frames[0].rgba;
    for (size_t at = 0; at < photos.frames[i].rgba.size(); ++at)
      if (at % 4 < 3) photos.frames[i].rgba[at] = static_cast<uint8_t>((at / 4 % 32 < 16 ? 160 : 220) / (1 + i % 2));
    if (i % 2 == 1) scene.frames[i].sensor = "back_camera";
  }
  Settings settings = tiny();
  settings.emplace_back("train.rate_exposure", "0.03");
  const auto method = configured("street-gaussians", settings);
  method->build({scene}, 3);
  load_data(*method, scene, photos);
  TrainOptions options;
  options.steps = 160;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  View view = view_of(scene.frames[0], scene.cameras[0], 0);
  const auto brightness = [&](const std::string& sensor) {
    view.sensor = sensor;
    double sum = 0;
    for (const float value : shown(*method, view).rgb) sum += double{value};
    return sum / (3 * 32 * 24);
  };
  const double bright = brightness("front_camera"), dark = brightness("back_camera"), between = brightness("");
  MESSAGE("brightness ", bright, ", of the darker camera ", dark, ", without an exposure ", between);
  CHECK(dark / bright == doctest::Approx(0.5).epsilon(0.1));
  CHECK(between < bright);
  CHECK(between > dark);
}

TEST_CASE("street-gaussians: boxes that stand wrong are moved to where photos show the actors") {
  const Folder folder;
  const ToyOptions size = {.frames = 6, .width = 64, .height = 48};
  const Scene truth = two_actors(folder.path, size);
  const Settings still = {{"train.rate_means", "0"},     {"train.rate_first", "0"},
                          {"train.rate_rest", "0"},      {"train.rate_scales", "0"},
                          {"train.rate_rotations", "0"}, {"train.rate_opacities", "0"},
                          {"train.rate_sky", "0"},       {"train.rate_positions", "0.02"},
                          {"growth.start", "100000"},    {"exposure", "false"},
                          {"weight.lidar", "0"},         {"initial.fewest", "150"}};
  const auto model = built(truth, still);
  for (const char* part : {"actors.opacities", "background.opacities"}) {
    const Shape shape = model->parameters().at(part).shape();
    put(*model, part, std::vector<float>(static_cast<size_t>(shape[0]), 4.f));
  }
  Pixels photos = toy_pixels(truth);
  for (size_t i = 0; i < truth.frames.size(); ++i) {
    const Picture picture = shown(*model, view_of(truth.frames[i], truth.cameras[0], 0));
    for (size_t at = 0; at < picture.rgb.size(); ++at)
      photos.frames[i].rgba[at / 3 * 4 + at % 3] = static_cast<uint8_t>(std::lround(255 * picture.rgb[at]));
  }
  Scene wrong = truth;
  const Vector3d off(0, 0.2, 0.1);  // to the side and up, as the camera sees it
  for (ActorBox& box : wrong.actors[0].boxes) box.world_from_box.topRightCorner<3, 1>() += off;
  Settings settings = tiny();
  settings.insert(settings.end(), still.begin(), still.end());
  const auto method = configured("street-gaussians", settings);
  method->build({wrong}, 3);
  load_data(*method, wrong, photos);
  for (const auto& [name, values] : model->parameters()) put(*method, name, values.to_host());
  TrainOptions options;
  options.steps = 150;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  const std::vector<float> learned = method->parameters().at("poses.positions").to_host();
  Vector3d first = Vector3d::Zero(), second = Vector3d::Zero();
  for (size_t box = 0; box < 6; ++box)
    for (size_t k = 0; k < 3; ++k) {
      first[static_cast<Eigen::Index>(k)] += double{learned[3 * box + k]} / 6;
      second[static_cast<Eigen::Index>(k)] += double{learned[3 * (11 + box) + k]} / 6;
    }
  MESSAGE("learned ", first.transpose(), " and, of the one that stands right, ", second.transpose());
  CHECK((first + off).tail<2>().norm() < 0.06);
  CHECK(second.tail<2>().norm() < 0.03);
}
