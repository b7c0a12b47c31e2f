// Depth maps beside photos: what is read of them, and what trainings make of it.
#include <doctest/doctest.h>

#include <algorithm>

#include "models/batches/image_source.h"
#include "models/batches/pixel_targets.h"
#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/eval/pictures.h"
#include "models/methods/splat_renderer.h"
#include "models/metrics/psnr.h"
#include "models/render/undistort.h"
#include "models/runs/captures.h"
#include "models/splat/parameters.h"
#include "models/train/trainer.h"
#include "tests/models/depth_room.h"
#include "tests/models/errors.h"
#include "tests/models/forward_facing.h"
#include "tests/models/made_method.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

LoadOptions with_depths(int factor = 1) { return {factor, false, MaskMeaning::ignore, true}; }

std::string depth_key(const std::string& file) { return R"(,"depth_file_path":")" + file + "\""; }

/// The mean share by which depths that are known differ from the truth at the pixels' middles.
double mean_error(const std::vector<float>& found, const std::vector<double>& truth) {
  REQUIRE(found.size() == truth.size());
  double sum = 0;
  for (std::size_t i = 0; i < found.size(); ++i) sum += std::abs(found[i] / truth[i] - 1);
  return sum / static_cast<double>(found.size());
}

/// Of renders of the test views, along rays.
double rendered_error(Method& method, const Scene& scene, const DepthRoom& room) {
  double sum = 0;
  for (int i = 0; i < room.test; ++i) {
    const Frame& frame = scene.frames[static_cast<std::size_t>(room.train + i)];
    const Picture picture = shown(method, {scene.cameras.front(), frame.world_from_camera});
    const auto seat = room.seats()[static_cast<std::size_t>(room.train + i)];
    sum += mean_error(picture.depth, room.depths(seat, room.width, room.height, true)) / room.test;
  }
  return sum;
}

/// Of one distance for all pixels: the median of the maps that train.
double constant_error(const DepthRoom& room) {
  std::vector<double> all;
  const auto seats = room.seats();
  for (int i = 0; i < room.train; ++i)
    for (const double depth : room.depths(seats[static_cast<std::size_t>(i)], 24, 18, true)) all.push_back(depth);
  std::sort(all.begin(), all.end());
  double sum = 0;
  for (int i = room.train; i < room.train + room.test; ++i) {
    const std::vector<double> truth = room.depths(seats[static_cast<std::size_t>(i)], room.width, room.height, true);
    sum += mean_error(std::vector<float>(truth.size(), static_cast<float>(all[all.size() / 2])), truth) / room.test;
  }
  return sum;
}

struct Learned {
  double error = 0, psnr = 0;  // of the test views: mean_error of distances; of colours
};

Learned learned(const std::string& name, const Settings& settings, int64_t steps) {
  const DepthRoom room;
  const Folder folder;
  room.write_with_depths(folder.path);
  const Scene scene = read_scene(folder.path);
  auto method = configured(name, settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train, with_depths()));
  TrainOptions options;
  options.steps = steps;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  Learned out{rendered_error(*method, scene, room)};
  for (const FramePixels& photo : load_images(scene, Split::test).frames) {
    const Picture picture = shown(*method, {scene.cameras.front(), scene.frames[photo.frame].world_from_camera});
    out.psnr += psnr(picture.rgb, on_white(photo)) / room.test;
  }
  return out;
}

Settings with(Settings settings, const std::string& key, const std::string& value) {
  settings.emplace_back(key, value);
  return settings;
}

}  // namespace

TEST_CASE("nerfstudio's depth maps: millimetres, units of the poses, distances, at the size of the photo") {
  const DepthRoom room;
  const Folder folder;
  const std::vector<DepthRoom::Seat> seats = room.seats();
  const std::vector<double> z = room.depths(seats[0], 24, 18), rays = room.depths(seats[0], 24, 18, true);
  room.write_with_depths(folder.path);
  std::vector<float> floats(z.begin(), z.end());
  write_exr(folder.path / "z.exr", 24, 18, {{"Z", floats.data()}});
  write_text(folder.path / "z.npy", npy_bytes("<f4", "18, 24", bytes_of_numbers<float>(z)));
  write_text(folder.path / "rays.npy", npy_bytes("<f8", "18, 24, 1", bytes_of_numbers<double>(rays)));
  const auto loaded = [&](const std::string& file, const std::string& keys, int factor) {
    room.write(
        folder.path, [&](std::size_t i) { return i == 0 ? depth_key(file) : std::string(); }, keys);
    const Scene scene = read_scene(folder.path);
    CHECK(scene.warnings.empty());
    CHECK(load_images(scene, Split::train).frames.at(0).depth.empty());
    const Pixels pixels = load_images(scene, Split::train, with_depths(factor));
    CHECK(pixels.frames.at(1).depth.empty());
    return pixels.frames.at(0).depth;
  };
  const std::vector<float> same = loaded("z.npy", "", 2);  // as large as the map
  REQUIRE(same.size() == z.size());
  for (std::size_t i = 0; i < z.size(); ++i) CHECK(same[i] == doctest::Approx(z[i]).epsilon(1e-6));
  CHECK(loaded("z.exr", "", 2) == same);
  CHECK(mean_error(loaded("depth0.png", "", 2), z) < 2e-4);
  CHECK(mean_error(loaded("rays.npy", R"(,"is_euclidean_depth":true)", 2), z) < 1e-6);
  CHECK(mean_error(loaded("depth0.png", R"(,"depth_unit_scale_factor":0.002)", 2), z) ==
        doctest::Approx(1).epsilon(1e-3));
  CHECK(mean_error(loaded("z.npy", R"(,"depth_unit_scale_factor":0.5)", 2), z) == doctest::Approx(0.5));
  write_text(folder.path / "stereo/depth_maps/0.png.geometric.bin", "24&18&1&" + bytes_of_numbers<float>(z));
  room.write(folder.path, [](std::size_t) { return std::string(); });
  CHECK(load_images(read_scene(folder.path), Split::train, with_depths(2)).frames.at(0).depth == same);
  // Two pixels of the photo a pixel of the map each way.
  const std::vector<float> twice = loaded("z.npy", "", 1);
  REQUIRE(twice.size() == 48 * 36);
  for (int y = 0; y < 36; ++y)
    for (int x = 0; x < 48; ++x)
      REQUIRE(twice[static_cast<std::size_t>(48 * y + x)] == same[static_cast<std::size_t>(24 * (y / 2) + x / 2)]);
}

TEST_CASE("depth maps: rays of batches end where things are, through any lens") {
  const DepthRoom room;
  for (const char* lens : {"", R"(,"k1":-0.2,"k2":0.05)", R"(,"camera_model":"OPENCV_FISHEYE")"}) {
    const Folder folder;
    room.write(
        folder.path, [](std::size_t) { return std::string(); }, lens);
    const std::vector<DepthRoom::Seat> seats = room.seats();
    const Camera camera = read_scene(folder.path).cameras.front();
    for (std::size_t i = 0; i < seats.size(); ++i) {  // as this lens sees the room
      std::vector<double> z;
      for (int y = 0; y < room.height; ++y)
        for (int x = 0; x < room.width; ++x) {
          const Eigen::Vector3d way = direction(camera, {x + 0.5, y + 0.5});
          z.push_back(room.look(seats[i], room.focal * way.x() / way.z() + 0.5 * room.width,
                                room.focal * way.y() / way.z() + 0.5 * room.height, room.width)
                          .depth);
        }
      write_text(folder.path / ("z" + std::to_string(i) + ".npy"),
                 npy_bytes("<f8", "36, 48", bytes_of_numbers<double>(z)));
    }
    room.write(
        folder.path, [](std::size_t i) { return depth_key("z" + std::to_string(i) + ".npy"); }, lens);
    const Scene scene = read_scene(folder.path);
    const Pixels pixels = load_images(scene, Split::train, with_depths());
    const SceneFrame frame = fit_scene(scene);
    const PixelBatch batch = PixelSource(scene, pixels, frame, RayRange()).draw(400, {1, 1, 0}, {});
    REQUIRE(batch.depths);
    const std::vector<float> from = batch.rays.origins.to_host(), towards = batch.rays.directions.to_host(),
                             depths = batch.depths.to_host();
    for (std::size_t r = 0; r < 400; ++r) {
      Eigen::Vector3d at;
      for (int k = 0; k < 3; ++k) at[k] = from[3 * r + k] + depths[r] * towards[3 * r + k];
      const Eigen::Vector3d point = frame.turn.transpose() * at / frame.scale + frame.centre;
      const double off = std::min({std::abs(point.z()), std::abs(point.y() - 2), std::abs(std::abs(point.x()) - 2.2),
                                   std::abs((point - Eigen::Vector3d(0, 0.6, 0.5)).norm() - 0.5)});
      REQUIRE(off < 1e-4);
    }
    // A pinhole with the lens's axes has the same depth at the same place.
    const Pixels straight = undistorted(pixels);
    const FramePixels& first = straight.frames.at(0);
    REQUIRE(first.depth.size() == first.rgba.size() / 4);
    std::vector<double> errors;
    for (int y = 0; y < first.height; ++y)
      for (int x = 0; x < first.width; ++x) {
        const float depth = first.depth[static_cast<std::size_t>(y * first.width + x)];
        const Eigen::Vector3d way = direction(straight.cameras.at(0), {x + 0.5, y + 0.5});
        const double truth = room.look(seats[0], room.focal * way.x() / way.z() + 0.5 * room.width,
                                       room.focal * way.y() / way.z() + 0.5 * room.height, room.width)
                                 .depth;
        if (depth > 0) errors.push_back(std::abs(depth / truth - 1));
      }
    std::sort(errors.begin(), errors.end());
    REQUIRE(errors.size() > first.depth.size() / 2);
    CHECK(errors[errors.size() * 3 / 4] < 0.03);  // but at edges; between the pixels of a slanted wall
  }
}

TEST_CASE("depth maps: what is not known takes no part") {
  const DepthRoom room;
  const Folder folder;
  std::vector<double> z = room.depths(room.seats()[0], 24, 18);
  z[0] = 0, z[1] = -1, z[2] = NAN, z[3] = INFINITY;
  write_text(folder.path / "z.npy", npy_bytes("<f4", "18, 24", bytes_of_numbers<float>(z)));
  Image mask{48, 36, 1, std::vector<std::uint8_t>(48 * 36, 255)};
  for (int x : {8, 9}) mask.pixels[static_cast<std::size_t>(x)] = mask.pixels[static_cast<std::size_t>(48 + x)] = 0;
  write_png(folder.path / "mask.png", mask);
  room.write(folder.path,
             [&](std::size_t i) { return i == 0 ? depth_key("z.npy") + R"(,"mask_path":"mask.png")" : std::string(); });
  const Scene scene = read_scene(folder.path);
  for (const MaskMeaning meaning : {MaskMeaning::ignore, MaskMeaning::transparent}) {
    const std::vector<float> depth = load_images(scene, Split::train, {2, false, meaning, true}).frames.at(0).depth;
    for (std::size_t i = 0; i < 6; ++i) CHECK((depth[i] > 0) == (i == 5));
  }
  const Tensor depths = from_host(std::vector<float>{0, 2}, {2}), lengths = from_host(std::vector<float>{5, 2}, {2});
  const auto loss = [&](const std::vector<float>& weights, const Tensor& at) {
    return depth_loss({at, from_host(weights, {2}), depths}, depths).item();
  };
  CHECK(loss({1, 1}, lengths) == doctest::Approx(0).epsilon(1e-6));
  CHECK(loss({1, 0}, lengths) == doctest::Approx(0.5));  // nothing is seen where the sensor saw something
  CHECK(loss({0.2f, 1}, from_host(std::vector<float>{5, 6}, {2})) == doctest::Approx(0.25));
}

TEST_CASE("depth maps: what is damaged or does not fit is named") {
  const DepthRoom room;
  const Folder folder;
  room.write_with_depths(folder.path);
  const auto error = [&](const std::string& file, const std::string& keys = "") {
    room.write(
        folder.path, [&](std::size_t) { return depth_key(file); }, keys);
    return error_of([&] { load_images(read_scene(folder.path), Split::train, with_depths()); });
  };
  CHECK(holds(error("gone.png"), "the depth map gone.png is missing; copy it to there, or remove depth_file_path"));
  CHECK(
      holds(error("depth0.png", R"(,"depth_unit_scale_factor":0)"), "depth_unit_scale_factor is 0, want more than 0"));
  CHECK(holds(error("../depth0.png"), "leaves"));
  CHECK(holds(error("0.png"), "0.png"));  // a photo is no depth map
  const std::string png = content_of(folder.path / "depth0.png");
  write_text(folder.path / "cut.png", png.substr(0, png.size() / 2));
  CHECK(holds(error("cut.png"), "cut.png"));
  write_text(folder.path / "flat.npy", npy_bytes("<f4", "432,", bytes_of_numbers<float>(std::vector<double>(432))));
  CHECK(holds(error("flat.npy"), "flat.npy: a depth map has the shape [height, width], this array has 1 axes"));
  write_text(folder.path / "short.npy", npy_bytes("<f4", "18, 24", "abc"));
  CHECK(holds(error("short.npy"), "short.npy: its shape asks for 1728 bytes of values, found 3"));
  write_text(folder.path / "high.npy", npy_bytes("<f4", "24, 18", bytes_of_numbers<float>(std::vector<double>(432))));
  CHECK(
      holds(error("high.npy"), "high.npy: a depth map of 18x24 pixels for a photo of 48x36: the aspect ratio differs"));
  write_text(folder.path / "depth.tif", "II*");
  CHECK(holds(error("depth.tif"), "depth.tif: want a depth map as .png, .exr, .npy or COLMAP's .bin"));
  const std::string floats = bytes_of_numbers<float>(std::vector<double>(431, 1));
  write_text(folder.path / "cut.bin", "24&18&1&" + floats);
  CHECK(holds(error("cut.bin"), "cut.bin: 24x18 depths take 1728 bytes, found 1724"));
  for (const char* head : {"24&18&3&", "24&18", "0&18&1&", "&18&1&", "123456789&1&1&"}) {
    write_text(folder.path / "head.bin", head + floats);
    CHECK(holds(error("head.bin"), "head.bin: is no depth map of COLMAP's"));
  }
  const std::vector<float> red(24 * 18, 1.f);
  write_exr(folder.path / "other.exr", 24, 18, {{"normal.X", red.data()}});
  CHECK(holds(error("other.exr"), "other.exr: no layer Z or Y or R, it has: normal.X"));
}

TEST_CASE("depth maps are read for photos that train, if the method uses them; one that does not is told") {
  const DepthRoom room;
  const Folder folder;
  room.write_with_depths(folder.path);
  for (const bool used : {true, false}) {
    const auto method = configured("nerf", {{"weight.depth", used ? "0.03" : "0"}});
    const auto& learns = *as<LearnsFromCaptures>(*method);
    Captures captures = read_captures({folder.path}, {}, {std::make_shared<HostStore>(0, 0), 0, learns.uses_depths()},
                                      [](auto&&...) {});
    const Capture& capture = captures.front();
    CHECK(capture.train[0]->depth.empty() == !used);
    CHECK(capture.test[0]->depth.empty());
    CHECK(capture.train.bytes() == (used ? 8U : 4U) * 48 * 36 * 5);
    add_warnings(captures, "nerf", *method);
    const std::string all = capture.warnings.empty() ? "" : capture.warnings.back();
    CHECK(holds(all, "the depth maps of 8 photos are not used by nerf") == !used);
  }
}

TEST_CASE("nerf and zipnerf: depth maps show where walls of one colour are") {
  const Settings small_zip = {{"grid.levels", "6"},       {"grid.log2_rows", "13"},   {"grid.finest", "128"},
                              {"field.width", "32"},      {"field.bottleneck", "32"}, {"field.colour_width", "32"},
                              {"proposal1.levels", "4"},  {"proposal1.finest", "32"}, {"proposal2.levels", "4"},
                              {"proposal2.finest", "64"}, {"proposals.width", "16"},  {"proposals.log2_rows", "12"},
                              {"samples.proposal", "16"}, {"samples.field", "16"},    {"sampling.multisamples", "1"},
                              {"batch.rays", "256"},      {"train.warm_up", "10"}};
  const double constant = constant_error(DepthRoom());
  for (const auto& [name, settings] : {std::pair{"nerf", small_hash()}, std::pair{"zipnerf", small_zip}}) {
    const Learned without = learned(name, with(settings, "weight.depth", "0"), 250),
                  maps = learned(name, settings, 250);
    MESSAGE(std::string(name), ": ", without.error, " and ", without.psnr, " dB without, ", maps.error, " and ",
            maps.psnr, " dB with, ", constant, " one distance");
    CHECK(maps.error < 0.5 * without.error);
    CHECK(maps.error < 0.25 * constant);
    CHECK(maps.psnr > without.psnr);
  }
}

TEST_CASE("splat: the depth of a wall is that along the axis, however little of it is seen") {
  const Camera camera{48, 36, 40, 40, 24, 18};
  Scene scene;
  scene.cameras = {camera};
  Frame frame;
  scene.frames = {frame};
  const auto error = [&](float opacity, const std::vector<float>& depths) {
    Params params;
    put_gaussians(params, {{0, 0, 3}, {2, 2, -7}, {1, 0, 0, 0}, {opacity}, {0, 0, 0}, std::vector<float>(45)});
    const SplatConfig config;
    const SplatRenderer renderer(config, scene, params, 1);
    const Photograph wall{from_host(std::vector<std::uint8_t>(4 * 48 * 36), {4, 36, 48}), Tensor(),
                          from_host(depths, {36, 48}), camera, frame.world_from_camera};
    return double{renderer.compare(wall, {0, CameraRefinement(), Progress{1, 1, 1, {}}, Tensor()}).depth_error.item()};
  };
  std::vector<float> z(48 * 36, 3.f), rays;
  for (int y = 0; y < 36; ++y)
    for (int x = 0; x < 48; ++x) rays.push_back(3 * static_cast<float>(direction(camera, {x + 0.5, y + 0.5}).norm()));
  for (const float opacity : {6.f, -1.f}) {
    CHECK(error(opacity, z) < 1e-5);
    CHECK(error(opacity, rays) > 0.02);
    CHECK(error(opacity, std::vector<float>(48 * 36, 6.f)) == doctest::Approx(1.0 / 3));
    CHECK(error(opacity, std::vector<float>(48 * 36, 0.f)) == 0);
  }
}

TEST_CASE("splat: depth maps show where walls of one colour are, and where to begin") {
  const Settings few = {{"initial.random", "2000"}}, random = with(few, "initial", "random");
  const Learned without = learned("splat", with(random, "weight.depth", "0"), 300),
                from_random = learned("splat", random, 300), maps = learned("splat", few, 300);
  const double constant = constant_error(DepthRoom());
  MESSAGE("splat: ", without.error, " and ", without.psnr, " dB without, ", from_random.error, " and ",
          from_random.psnr, " dB from random points, ", maps.error, " and ", maps.psnr, " dB with, ", constant,
          " one distance");
  CHECK(from_random.error < 0.6 * without.error);
  CHECK(maps.error < 0.6 * without.error);
  CHECK(maps.error < 0.25 * constant);
  CHECK(maps.psnr > without.psnr - 0.3);
  CHECK(holds(error_of([&] {
                const DepthRoom room;
                const Folder folder;
                room.write(folder.path, [](std::size_t) { return std::string(); });
                configured("splat", {{"initial", "depths"}})->build({read_scene(folder.path)}, 1);
              }),
              "initial=depths: the capture has no depth maps"));
}
