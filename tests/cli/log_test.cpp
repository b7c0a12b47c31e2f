// Driving logs through the program: a sound one is reported on, a hostile one is exit 3 and runs nothing.
#include <doctest/doctest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "models/data/write_pandaset.h"
#include "models/io/commit.h"
#include "models/io/gzip.h"
#include "models/io/image.h"
#include "models/io/safetensors.h"
#include "tests/cli/process.h"
#include "tests/hostile_pickles.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

// One camera, a parked car with a point in it.
fs::path small_log(const std::string& name, int steps = 2) {
  Scene log;
  log.is_log = true;
  log.cameras = {{16, 12, 10, 10, 8, 6, CameraModel::pinhole, {}, 0, 0}};
  log.actors = {{"a", "Car", {2, 4, 1.5}, true, {}}};
  for (int step = 0; step < steps; ++step) {
    Frame frame;
    frame.sensor = "front_camera";
    frame.step = step;
    frame.timestamp = 0.1 * step;
    frame.world_from_camera(0, 3) = step;
    log.frames.push_back(frame);
    log.sweeps.push_back({"", 0.1 * step, Eigen::Matrix4d::Identity(), step, Split::train});
    log.actors[0].boxes.push_back({step, 0.1 * step, Eigen::Matrix4d::Identity()});
  }
  const auto image = [](const Frame&) { return Image{16, 12, 3, std::vector<std::uint8_t>(3 * 16 * 12, 90)}; };
  const auto points = [](const Sweep&) { return LidarPoints{{0, 0, 0.5f}, {0.5f}, {0}, {0}, 0}; };
  write_pandaset(scratch() / name, log, {image, points});
  return scratch() / name;
}

/// A run of two steps on a log of twelve, by the protocol sparse.
struct SparseRun {
  fs::path log = small_log("sparse-log", 12), run = scratch() / "sparse-run";
  Outcome trained = cloam_with(small_training(log, run, {"--steps", "2", "--protocol", "sparse"}));
};
const SparseRun& sparse_run() {
  static const SparseRun made;
  REQUIRE_MESSAGE(made.trained.code == 0, made.trained.err);
  return made;
}

/// AlexNet and LPIPS's linear layers, all zeros.
fs::path lpips_weights() {
  const fs::path path = scratch() / "lpips.safetensors";
  SafetensorsFile file;
  const auto put = [&](const std::string& name, const std::vector<int64_t>& shape) {
    std::size_t bytes = 4;
    for (const int64_t extent : shape) bytes *= static_cast<std::size_t>(extent);
    file.tensors[name] = {"F32", shape, std::vector<std::byte>(bytes)};
  };
  const std::vector<std::vector<int64_t>> shapes = {
      {64, 3, 11, 11}, {192, 64, 5, 5}, {384, 192, 3, 3}, {256, 384, 3, 3}, {256, 256, 3, 3}};
  const int numbers[] = {0, 3, 6, 8, 10};
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    put("features." + std::to_string(numbers[i]) + ".weight", shapes[i]);
    put("features." + std::to_string(numbers[i]) + ".bias", {shapes[i][0]});
    put("lin" + std::to_string(i) + ".model.1.weight", {1, shapes[i][0], 1, 1});
  }
  write_safetensors(path, file);
  return path;
}

}  // namespace

TEST_CASE("check reports on a log") {
  const fs::path log = small_log("log");
  const Outcome checked = cloam_with({"check", log.string(), "--json"});
  REQUIRE_MESSAGE(checked.code == 0, checked.err);
  const auto json = nlohmann::json::parse(checked.out);
  CHECK(json["format"] == "PandaSet");
  CHECK(json["log"]["steps"] == 2);
  CHECK(json["log"]["boxes"] == 2);
  CHECK(json["log"]["boxes_without_points"] == 0);
  CHECK(json["log"]["lidar_fit"][0]["camera"] == "front_camera");
  const Outcome told = cloam_with({"check", log.string()});
  CHECK(told.out.find("1 actors with 2 boxes") != std::string::npos);
  CHECK(told.err.find("next: cloam train genassets ") != std::string::npos);
}

TEST_CASE("synth makes logs that check finds sound, and never in silence over others") {
  const fs::path out = scratch() / "streets";
  const Words words = {"synth", "-o",        out.string(),        "--logs", "2",     "--frames", "2", "--seed",
                       "3",     "--cameras", "back,front_camera", "--size", "64x36", "--night",  "1"};
  const Outcome made = cloam_with(words);
  REQUIRE_MESSAGE(made.code == 0, made.err);
  CHECK(made.out.empty());
  CHECK(made.err.find("36/36 pictures") != std::string::npos);  // 2 logs of 2 steps: 2 cameras and 7 turns
  for (const char* file : {"camera/back_camera/01.jpg", "truth/back_camera/01_depth.npy", "truth/actors.json",
                           "truth/rot045/front_camera/00.jpg", "truth/rot315/front_camera/01_actor.png"}) {
    CHECK_MESSAGE(fs::exists(out / "002" / file), file);
  }
  CHECK(json_of(out / "001/meta/time_of_day.json")["night"] == true);
  const Outcome checked = cloam_with({"check", (out / "002").string(), "--json"});
  REQUIRE_MESSAGE(checked.code == 0, checked.err);
  const auto json = nlohmann::json::parse(checked.out);
  CHECK(json["images"] == 4);
  CHECK(json["warnings"].empty());
  CHECK(json["log"]["actors"] >= 10);
  const Outcome told = cloam_with({"check", (out / "002").string()});
  CHECK(told.out.find("back_camera: LiDAR aligns with the images (offset ") != std::string::npos);
  const auto before = snapshot(out);
  CHECK(cloam_with(words).code == 2);
  CHECK(snapshot(out) == before);
  Words shorter = words;
  shorter[6] = "1";
  shorter.push_back("--overwrite");
  CHECK(cloam_with(shorter).code == 0);
  CHECK_FALSE(fs::exists(out / "001/camera/back_camera/01.jpg"));
  const std::string other = (scratch() / "none").string();
  for (const Words& wrong : {Words{"--cameras", "frnt"}, Words{"--size", "64"}, Words{"--size", "8x8"},
                             Words{"--frames", "0"}, Words{"--rate", "0.2"}, Words{"--night", "2"}}) {
    const Outcome refused = cloam_with({"synth", "-o", other, wrong[0], wrong[1]});
    CHECK_MESSAGE(refused.code == 2, refused.err);
  }
  CHECK(cloam_with({"synth", "-o", other, "--cameras", "frnt"}).err.find("did you mean front?") != std::string::npos);
  CHECK_FALSE(fs::exists(other));
}

TEST_CASE("a log as recorded: check says what it found of its clock, and a run keeps it") {
  const fs::path out = scratch() / "as-recorded";
  const Outcome made = cloam_with({"synth", "-o", out.string(), "--logs", "2", "--frames", "3", "--size", "48x27",
                                   "--cameras", "front,back", "--no-truth", "--as-recorded", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  for (const bool dead : {true, false}) {
    const std::string log = (out / (dead ? "001" : "002")).string();
    const auto clock = nlohmann::json::parse(cloam_with({"check", log, "--json"}).out)["log"]["clock"];
    CHECK(clock["sweep_seconds"] == 0.1);
    CHECK(clock["sweep_stamp_after_middle"] == 0.05);
    CHECK(clock["image_stamp_after_middle"] == 0.01);
    CHECK(clock["cameras_after_sweep"]["back_camera"].get<double>() == doctest::Approx(-0.05).epsilon(1e-3));
    CHECK(clock["boxes_after_sweep"][0] < -0.01);
    CHECK(clock["boxes_after_sweep"][1] > 0.01);
    CHECK((clock["lidar_poses_replaced"] >= 2) == dead);
    CHECK(clock["second_lidar_points"] > 500);
    CHECK(clock["second_lidar_placed"] == true);
    CHECK(clock["car_points"] > 500);
    CHECK(clock["car_rows"]["back_camera"].get<double>() == doctest::Approx(260.0 / 1080));
    const std::string words = cloam_with({"check", log}).out;
    CHECK((words.find("judged wrong; the front camera's poses and times are used") != std::string::npos) == dead);
    CHECK(words.find("points, seen from its own place") != std::string::npos);
  }
  const fs::path run = scratch() / "as-recorded-run";
  const Outcome trained = cloam_with(small_training(out / "001", run, {"--steps", "2"}));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  const auto record = json_of(run / "run.json");
  REQUIRE(record.at("reading").at("recordings").size() == 1);
  CHECK(record.at("reading").at("recordings")[0]["poses_replaced"] >= 2);
  CHECK(record.at("reading").at("recordings")[0]["second_lidar"][1] == 1.2);
}

TEST_CASE("hostile pickles in a log: exit 3, the file named, nothing run") {
  const fs::path log = small_log("hostile"), canary = scratch() / "canary";
  const char* files[] = {"annotations/cuboids/01.pkl.gz", "lidar/01.pkl.gz"};
  const std::vector<HostilePickle> pickles = hostile_pickles(canary.string());  // data_frame_test.cpp reads every one
  CHECK(pickles.size() >= 50);
  for (std::size_t i = 0; i < pickles.size(); i += 7) {
    const HostilePickle& pickle = pickles[i];
    CAPTURE(pickle.name);
    const fs::path file = log / files[i % 2];
    const std::string sound = content_of(file);
    const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(pickle.bytes.data()),
                                              pickle.bytes.size());
    const auto packed = gzip(bytes);
    commit_bytes(file, std::as_bytes(std::span(packed)));
    const Outcome checked = cloam_with({"check", log.string()});
    CHECK_MESSAGE(checked.code == 3, checked.err);
    CHECK_MESSAGE(checked.err.find(file.filename().string()) != std::string::npos, checked.err);
    CHECK_FALSE(fs::exists(canary));
    write_text(file, sound);
  }
  write_text(log / files[1], "no pickle");
  CHECK(cloam_with({"check", log.string()}).code == 3);
  const Outcome skipping = cloam_with({"check", log.string(), "--skip-bad"});
  CHECK(skipping.code == 0);
  CHECK(skipping.err.find("left out of the check") != std::string::npos);
  fs::remove(log / files[1]);
  CHECK(cloam_with({"check", log.string()}).code == 0);
}

TEST_CASE("the paper's preset is planned in epochs of the images that train") {
  const fs::path log = small_log("epochs");
  std::size_t images = 0;
  for (const auto& entry : fs::recursive_directory_iterator(log / "camera"))
    images += entry.path().extension() == ".jpg";
  const Outcome planned = cloam_with({"train", "genassets", log.string(), "--set", "weight.perceptual=0", "--dry-run",
                                      "-o", (scratch() / "p").string()});
  CHECK_MESSAGE(planned.code == 0, planned.err);
  REQUIRE(images > 0);
  CHECK_MESSAGE(planned.err.find(std::to_string(100 * images) + " steps (100 epochs)") != std::string::npos,
                planned.err);
}

TEST_CASE("training says what a log or a method lacks") {
  const auto plan = [](const char* method, const fs::path& data) {
    const Outcome planned = cloam_with({"train", method, data.string(), "--dry-run", "-o", (scratch() / "p").string()});
    CHECK_MESSAGE(planned.code == 0, planned.err);
    return planned.err;
  };
  const auto says = [](const std::string& all, const char* part) { return all.find(part) != std::string::npos; };
  const fs::path log = small_log("told");
  for (const char* method : {"nerf", "splat"})
    CHECK(says(plan(method, log), "street-gaussians and genassets model them separately"));
  CHECK_FALSE(says(plan("splat", log), "random positions"));  // it begins with LiDAR's points
  CHECK_FALSE(says(plan("nerf", small_scene()), "genassets"));
  CHECK(says(plan("splat", small_scene()), "no points: Gaussians start at random positions"));
  fs::remove_all(log / "annotations");
  fs::remove_all(log / "lidar");
  const Words bare = {"train", "genassets",           log.string(), "--preset", "genassets-small",
                      "--set", "weight.perceptual=0", "--dry-run",  "-o",       (scratch() / "p").string()};
  const Outcome planned = cloam_with(bare);
  REQUIRE_MESSAGE(planned.code == 0, planned.err);
  CHECK(says(planned.err, "without boxes, genassets learns everything as background"));
  CHECK(says(planned.err, "without LiDAR sweeps, genassets learns depth from images alone"));
}

TEST_CASE("a protocol chooses the training images of a log, and the record says so") {
  const auto& [log, run, trained] = sparse_run();
  CHECK(trained.err.find("protocol sparse: 4 for training, 8 for evaluation") != std::string::npos);  // 0, 5, 10, 11
  CHECK(json_of(run / "run.json").at("reading").at("protocol") == "sparse");
  const auto scene = json_of(run / "scene.json").at("scenes").at(0);
  CHECK(scene.at("frames").at(11).at("split") == "train");
  CHECK(scene.at("sweeps").at(1).at("split") == "test");
  CHECK(scene.at("actors").at(0).at("boxes") == 12);
  CHECK(cloam_with({"train", "--resume", run.string(), "--protocol", "novel"}).code == 2);
  const fs::path never = scratch() / "protocol-never";
  const auto training = [&, &data = log](const Words& more) { return cloam_with(small_training(data, never, more)); };
  CHECK(training({"--protocol", "sparse", "--holdout", "3"}).code == 2);
  CHECK(training({"--protocol", "dense"}).code == 2);
  CHECK(training({"--sparse-every", "3"}).code == 2);
  CHECK(cloam_with(small_training(small_scene(), never, {"--protocol", "sparse"})).code == 2);  // photos
  CHECK_FALSE(fs::exists(never));
}

TEST_CASE("methods for one capture refuse several, and networks of others") {
  const fs::path a = small_log("one"), b = small_log("two"), run = scratch() / "several";
  Words words = small_training(a, run, {"--steps", "2"});
  words.insert(words.begin() + 3, b.string());
  const Outcome several = cloam_with(words);
  CHECK(several.code == 2);
  CHECK(several.err.find("one capture") != std::string::npos);
  REQUIRE(cloam_with(small_training(a, run, {"--steps", "2"})).code == 0);
  const Outcome networks =
      cloam_with({"train", "nerf", b.string(), "--networks", run.string(), "-o", (scratch() / "adopting").string()});
  CHECK(networks.code == 2);
  CHECK(networks.err.find("--networks does not work with nerf") != std::string::npos);
  const Outcome method = cloam_with(
      {"train", "genassets", b.string(), "--networks", run.string(), "-o", (scratch() / "adopting").string()});
  CHECK(method.code == 2);
  CHECK(method.err.find("--networks needs a genassets run; " + run.string() + " is nerf") != std::string::npos);
  CHECK_FALSE(fs::exists(scratch() / "adopting"));
}

TEST_CASE("eval of a log prints the figures over actors and the guesses to clear, by log too") {
  const fs::path log = sparse_run().log, run = sparse_run().run;
  const std::string weights = lpips_weights().string();
  const Outcome perceptual = cloam_with({"eval", run.string(), "--lpips", weights, "--json"});
  REQUIRE_MESSAGE(perceptual.code == 0, perceptual.err);
  const auto distances = nlohmann::json::parse(perceptual.out);
  CHECK(distances.at("perceptual_network") == "lpips-alex-v0.1, unverified weights");
  CHECK(distances.at("masked_perceptual_distance").is_null());  // pictures of 16x12: too small for AlexNet
  CHECK_FALSE(distances.contains("lpips"));
  CHECK(cloam_with({"eval", run.string(), "--lpips", weights + ",none.pth"}).code == 3);
  const Outcome compared = cloam_with({"compare", run.string(), "--lpips", weights, "--json"});
  REQUIRE_MESSAGE(compared.code == 0, compared.err);
  CHECK_FALSE(contains(compared.err, "evaluating"));  // what is there was measured by this network
  CHECK(nlohmann::json::parse(compared.out).at("runs").at(0).at("perceptual_network") ==
        "lpips-alex-v0.1, unverified weights");
  const Outcome evaluated = cloam_with({"eval", run.string(), "--json"});
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  const auto json = nlohmann::json::parse(evaluated.out);
  for (const char* key : {"psnr", "ssim", "masked_psnr", "masked_ssim", "lidar_median_error_m", "lidar_chamfer_m2",
                          "baseline_blend_psnr", "baseline_blend_masked_psnr", "baseline_mean_masked_psnr",
                          "baseline_copy_psnr", "baseline_copy_masked_psnr", "baseline_row_mean_psnr", "moving_psnr",
                          "baseline_blend_moving_psnr", "baseline_copy_moving_psnr", "baseline_mean_moving_psnr"}) {
    CAPTURE(key);
    CHECK(json.contains(key));
    CHECK(json.at("logs").at(0).contains(key));
  }
  CHECK(json.at("schema_version") == 2);
  CHECK(json.at("protocol") == "sparse");
  CHECK(json.at("images") == 8);
  CHECK(json.at("masks") == "boxes");
  CHECK(json.at("logs").at(0).at("name") == "sparse-log");
  CHECK(json_of(run / "eval" / "eval.json").at("per_image").size() == 8);
  const std::string actors = content_of(run / "eval" / "per_actor.csv");
  CHECK(
      actors.starts_with("log,image,actor,label,moves,pixels,psnr,baseline_mean_psnr,view_degrees\n"
                         "\"sparse-log\",\"camera/front_camera/"));
  const Outcome novel = cloam_with({"eval", run.string(), "--protocol", "novel"});
  CHECK(novel.code == 3);
  CHECK(novel.err.find("front_left_camera") != std::string::npos);
  const auto turned = cloam_with({"eval", run.string(), "--protocol", "rotate360", "--features", "random", "--json"});
  REQUIRE_MESSAGE(turned.code == 0, turned.err);
  const auto rotated = nlohmann::json::parse(turned.out);
  // The camera drives off from the middle of the car, a metre a step: the turned car of 2 m x 4 m holds it (0.2 m of
  // room included) below 1.70 m at the four odd angles, below 2.20 m at 90 and 270 degrees, below 1.20 m at 0 and 180.
  const int as_recorded = 12 - 2, measured = as_recorded + 7 * 12 - (4 * 2 + 2 * 3 + 2);
  CHECK(rotated.at("images") == measured);
  CHECK(rotated.at("psnr").is_null());  // the log has no images of turned actors
  CHECK(rotated.at("frechet_feature_distance").is_number());
  CHECK(rotated.at("kernel_feature_distance").is_number());
  CHECK(rotated.at("set_images") == std::vector<int>{measured, 4});
  CHECK(rotated.at("without_0").at("images") == measured - as_recorded);
  CHECK(rotated.at("without_0").at("set_images") == std::vector<int>{measured - as_recorded, 4});
  CHECK(rotated.at("without_0").at("frechet_feature_distance") != rotated.at("frechet_feature_distance"));
  CHECK_FALSE(rotated.contains("fid"));
  // Truth of some moments at some angles: those are measured, and told.
  for (const char* file : {"rot045/front_camera/03", "rot045/front_camera/09", "rot180/front_camera/11"})
    write_jpeg(log / "truth" / (std::string(file) + ".jpg"), {16, 12, 3, std::vector<std::uint8_t>(3 * 16 * 12, 90)});
  const auto some = cloam_with({"eval", run.string(), "--protocol", "rotate360", "--json"});
  REQUIRE_MESSAGE(some.code == 0, some.err);
  // At 0 degrees the recorded images of the same three moments.
  CHECK(some.err.find("truth/ has 6 of " + std::to_string(measured) + " images of turned actors") != std::string::npos);
  const auto six = nlohmann::json::parse(some.out);
  CHECK(six.at("images") == 6);
  CHECK(six.at("psnr").is_number());
  CHECK(six.at("without_0").at("images") == 3);
  double turned_psnr = 0;  // the mean as it was before 0 degrees counted
  std::multiset<int> angles;
  const auto kept = json_of(run / "eval" / "eval.json");
  for (const auto& image : kept.at("per_image")) {
    angles.insert(image.at("degrees").get<int>());
    if (image.at("degrees") != 0) turned_psnr += image.at("psnr").get<double>() / 3;
  }
  CHECK(angles == std::multiset<int>{0, 0, 0, 45, 45, 180});
  CHECK(six.at("without_0").at("psnr").get<double>() == doctest::Approx(turned_psnr));
  CHECK(content_of(run / "eval" / "per_image.csv").starts_with("log,image,degrees,psnr"));
  CHECK(content_of(run / "eval" / "per_actor.csv").starts_with("log,image,degrees,actor,label"));
  // Masks of one image alone: in the others boxes stand for actors.
  write_text(log / "truth" / "actors.json", R"({"1": "a"})");
  fs::create_directories(log / "truth" / "front_camera");
  write_png(log / "truth" / "front_camera" / "03_actor.png", {16, 12, 1, std::vector<std::uint8_t>(16 * 12, 1)});
  const auto mixed = cloam_with({"eval", run.string(), "--json"});
  REQUIRE_MESSAGE(mixed.code == 0, mixed.err);
  CHECK(mixed.err.find("1 of 8 images have actor masks in truth/") != std::string::npos);
  CHECK(nlohmann::json::parse(mixed.out).at("masks") == "truth and boxes");
  // A damaged mask of a training photo costs the angles, and nothing else.
  write_png(log / "truth" / "front_camera" / "00_actor.png", {3, 2, 1, std::vector<std::uint8_t>(3 * 2, 1)});
  const auto damaged = cloam_with({"eval", run.string(), "--json"});
  REQUIRE_MESSAGE(damaged.code == 0, damaged.err);
  CHECK(contains(damaged.err, "no view_degrees in per_actor.csv: "));
  CHECK(contains(damaged.err, "00_actor.png: the mask has 3x2 pixels"));
  CHECK(nlohmann::json::parse(damaged.out).at("psnr") == nlohmann::json::parse(mixed.out).at("psnr"));
}

TEST_CASE("render shows a log's camera at any time and size, by log, camera and step") {
  const fs::path log = small_log("render-log", 12), run = scratch() / "render-run", out = scratch() / "renders";
  REQUIRE(cloam_with(small_training(log, run, {"--steps", "2", "--holdout", "4"})).code == 0);
  const auto render = [&](const Words& more) {
    Words words = {"render", run.string(), "-o", out.string()};
    words.insert(words.end(), more.begin(), more.end());
    return cloam_with(words);
  };
  const auto written = [&](const char* name) { return fs::exists(out / name); };
  CHECK(render({}).code == 0);
  for (const char* name : {"00", "04", "08"})
    CHECK(written((std::string("camera_front_camera_") + name + ".png").c_str()));
  CHECK_FALSE(written("camera_front_camera_01.png"));
  CHECK(render({"--step", "1", "--log", "render-log", "--camera-name", "front_camera"}).code == 0);
  CHECK(written("camera_front_camera_01.png"));
  REQUIRE(render({"--time", "+0.25", "--size", "40x10"}).code == 0);
  const ImageSize size = read_image_size(out / "front_camera_0.250.png");
  CHECK((size.width == 40 && size.height == 10));
  for (const Words& wrong :
       {Words{"--time", "99"}, Words{"--time", "soon"}, Words{"--size", "40"}, Words{"--log", "1"},
        Words{"--camera-name", "rear"}, Words{"--masks"}, Words{"--lidar"}, Words{"--step", "1", "--time", "1"}}) {
    CAPTURE(wrong[0]);
    CHECK(render(wrong).code == 2);
  }
}
