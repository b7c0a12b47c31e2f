// eval and render: figures with their baselines, pictures that are there and right.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "models/io/image.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const fs::path& trained() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "trained";
    REQUIRE(cloam_with(small_training(small_scene(), folder, {"--steps", "400"})).code == 0);
    return folder;
  }();
  return run;
}

/// Mean over the test photos of the PSNR of a picture of the training photos' mean colour, from the files alone; of
/// photos whose squares of `factor` pixels are one.
double mean_colour_figure(std::size_t factor = 1) {
  const auto pixels = [&](const char* split, int index) {
    const Image image = read_image(small_scene() / split / ("r_" + std::to_string(index) + ".png"));
    const std::size_t width = 24 / factor;
    std::vector<double> rgb(3 * width * width);
    for (std::size_t i = 0; i < image.pixels.size(); i += 4) {
      const double alpha = image.pixels[i + 3] / 255.0;
      const std::size_t square = i / 4 / 24 / factor * width + i / 4 % 24 / factor;
      for (std::size_t c = 0; c < 3; ++c)
        rgb[3 * square + c] += (alpha * image.pixels[i + c] / 255.0 + 1 - alpha) / static_cast<double>(factor * factor);
    }
    return rgb;
  };
  double colour[3] = {0, 0, 0};
  for (int view = 0; view < 8; ++view) {
    const auto rgb = pixels("train", view);
    for (std::size_t i = 0; i < rgb.size(); ++i) colour[i % 3] += 3 * rgb[i] / (8.0 * static_cast<double>(rgb.size()));
  }
  double sum = 0;
  for (int view = 0; view < 2; ++view) {
    const auto rgb = pixels("test", view);
    double square = 0;
    for (std::size_t i = 0; i < rgb.size(); ++i) square += std::pow(rgb[i] - colour[i % 3], 2);
    sum += -10 * std::log10(square / static_cast<double>(rgb.size())) / 2;
  }
  return sum;
}

}  // namespace

TEST_CASE("eval --json prints one object with figures and baselines, and writes its files") {
  const Outcome outcome = cloam_with({"eval", trained().string(), "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  CHECK(json.at("schema_version") == 2);
  CHECK(json.at("protocol") == "test-split");
  CHECK(json.at("images") == 2);
  CHECK(json.at("step") == 400);
  CHECK(json.at("psnr").get<double>() > mean_colour_figure() + 3);  // it has learnt the scene
  CHECK(json.at("ssim").get<double>() <= 1);
  CHECK(json.at("baseline_mean_colour_psnr").get<double>() == doctest::Approx(mean_colour_figure()).epsilon(1e-4));
  CHECK(json.at("baseline_nearest_frame_psnr").is_number());
  const auto file = json_of(trained() / "eval" / "eval.json");
  CHECK(file.at("per_image").size() == 2);
  const double mean = (file["per_image"][0]["psnr"].get<double>() + file["per_image"][1]["psnr"].get<double>()) / 2;
  CHECK(json.at("psnr").get<double>() == doctest::Approx(mean));
  CHECK(contains(content_of(trained() / "eval" / "per_image.csv"), "test/r_1.png"));
}

TEST_CASE("eval --downscale measures photos of another size than the training's, and says which") {
  const std::string run = trained().string(), record = content_of(trained() / "run.json");
  const Outcome outcome = cloam_with({"eval", run, "--downscale", "4", "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  CHECK(json.at("downscale") == 4);
  CHECK(json.at("baseline_mean_colour_psnr").get<double>() == doctest::Approx(mean_colour_figure(4)).epsilon(1e-3));
  CHECK(json.at("psnr").get<double>() > mean_colour_figure(4) + 3);
  CHECK(read_image(trained() / "eval" / "images" / "test_r_0.png").height == 6);
  CHECK(content_of(trained() / "run.json") == record);
  CHECK(contains(cloam_with({"eval", run, "--downscale", "4"}).out, ", photos shrunk by 4\n"));
  const Outcome compared = cloam_with({"compare", run});  // with others of the training's size
  REQUIRE_MESSAGE(compared.code == 0, compared.err);
  CHECK(json_of(trained() / "eval" / "eval.json").at("downscale") == 1);
  const Outcome large = cloam_with({"eval", run, "--downscale", "25"});
  CHECK(large.code == 2);
  CHECK(contains(large.err, "--downscale 25"));
}

TEST_CASE("eval's pictures show render, photo and error side by side") {
  REQUIRE(cloam_with({"eval", trained().string(), "-q", "--images", (scratch() / "shown").string()}).code == 0);
  const Image sheet = read_image(scratch() / "shown" / "test_r_0.png");
  CHECK(sheet.height == 24);
  CHECK(sheet.width == 3 * 24 + 2 * 4);
  const Image photo = read_image(small_scene() / "test" / "r_0.png");
  for (const std::size_t at : {std::size_t{0}, std::size_t{12 * 24 + 12}}) {
    const std::size_t row = at / 24, column = at % 24;
    const int alpha = photo.pixels[4 * at + 3];
    const int wanted = (photo.pixels[4 * at] * alpha + 255 * (255 - alpha) + 127) / 255;
    CHECK(std::abs(int{sheet.pixels[3 * (row * static_cast<std::size_t>(sheet.width) + 28 + column)]} - wanted) <= 1);
  }
}

TEST_CASE("eval of a run without held-out photos says that they are the training photos") {
  const fs::path data = copy_of_scene("no-test");
  fs::rename(data / "transforms_train.json", data / "transforms.json");
  fs::remove(data / "transforms_test.json");
  const fs::path run = scratch() / "no-test-run";
  REQUIRE(cloam_with(small_training(data, run, {"--steps", "5"})).code == 0);
  const Outcome outcome = cloam_with({"eval", run.string(), "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(nlohmann::json::parse(outcome.out).at("protocol") == "train-images");
  CHECK(contains(outcome.err, "the training images are evaluated"));
}

TEST_CASE("--holdout N is the protocol holdout-N: every Nth by name") {
  const fs::path data = copy_of_scene("held-out");
  fs::rename(data / "transforms_train.json", data / "transforms.json");
  fs::remove(data / "transforms_test.json");
  const fs::path run = scratch() / "held-out-run";
  REQUIRE(cloam_with(small_training(data, run, {"--steps", "5", "--holdout", "4"})).code == 0);
  const Outcome outcome = cloam_with({"eval", run.string(), "--json"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto json = nlohmann::json::parse(outcome.out);
  CHECK(json.at("protocol") == "holdout-4");
  CHECK(json.at("images") == 2);
  const std::string csv = content_of(run / "eval" / "per_image.csv");
  CHECK(contains(csv, "r_0"));
  CHECK(contains(csv, "r_4"));
}

TEST_CASE("eval --data takes the other folder's test split, else all its photos") {
  const Outcome split = cloam_with({"eval", trained().string(), "--json", "--data", small_scene().string()});
  REQUIRE(split.code == 0);
  CHECK(nlohmann::json::parse(split.out).at("images") == 2);
  const fs::path data = copy_of_scene("other");
  fs::rename(data / "transforms_train.json", data / "transforms.json");
  fs::remove(data / "transforms_test.json");
  const Outcome all = cloam_with({"eval", trained().string(), "--json", "--data", data.string()});
  REQUIRE_MESSAGE(all.code == 0, all.err);
  CHECK(nlohmann::json::parse(all.out).at("images") == 8);
  CHECK(nlohmann::json::parse(all.out).at("protocol") == "all-images");
}

TEST_CASE("render writes the views, needs no photos for it, and EXR layers can be read") {
  const fs::path out = scratch() / "views";
  const Outcome outcome = cloam_with({"render", trained().string(), "-o", out.string(), "--split", "test", "--exr"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(outcome.err, out.string()));
  for (const char* name : {"test_r_0", "test_r_1"}) {
    CHECK(read_image(out / (std::string(name) + ".png")).width == 24);
    for (const char* layer : {"R", "G", "B", "A", "depth.Z", "opacity.A"}) {
      const auto values = read_exr_layer(out / (std::string(name) + ".exr"), layer);
      REQUIRE(values.size() == 24 * 24);
      CHECK(std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v) && v >= 0; }));
    }
  }
}

TEST_CASE("an orbit is rendered as pictures and as a GIF") {
  const fs::path out = scratch() / "orbit";
  REQUIRE(cloam_with({"render", trained().string(), "-o", out.string(), "--path", "orbit", "--frames", "3"}).code == 0);
  CHECK(read_image(out / "orbit_0002.png").height == 24);
  const std::string gif = content_of(out / "orbit.gif");
  CHECK(gif.starts_with("GIF89a"));
  CHECK(std::count(gif.begin(), gif.end(), '\x2c') >= 3);  // an image descriptor a frame
}

TEST_CASE("a path through the cameras shows what they see, in order") {
  const fs::path all = scratch() / "stops", out = scratch() / "walk";
  REQUIRE(cloam_with({"render", trained().string(), "-o", all.string(), "--split", "all"}).code == 0);
  REQUIRE(
      cloam_with({"render", trained().string(), "-o", out.string(), "--path", "interpolated", "--frames", "19"}).code ==
      0);
  CHECK(content_of(out / "interpolated.gif").starts_with("GIF89a"));
  const auto apart = [&](const std::string& frame, const std::string& view) {
    const Image a = read_image(out / (frame + ".png")), b = read_image(all / (view + ".png"));
    REQUIRE(a.pixels.size() == b.pixels.size());
    int most = 0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) most = std::max(most, std::abs(a.pixels[i] - b.pixels[i]));
    return most;
  };
  CHECK(apart("interpolated_0000", "test_r_0") <= 1);  // ten cameras, a picture between each two
  CHECK(apart("interpolated_0004", "train_r_0") <= 1);
  CHECK(apart("interpolated_0018", "train_r_7") <= 1);
  CHECK(apart("interpolated_0003", "train_r_0") > 1);
  CHECK(cloam_with({"render", trained().string(), "-o", out.string(), "--path", "orbit", "--camera", "x"}).code == 2);
}

TEST_CASE("a path becomes a film where ffmpeg is installed, and nothing fails where it is not or does") {
  const fs::path out = scratch() / "100 % films", bin = scratch() / "bin", calls = scratch() / "ffmpeg-calls";
  fs::create_directories(bin);
  const auto render = [&](const Words& environment) {
    const Outcome outcome =
        cloam_with({"render", trained().string(), "-o", out.string(), "--path", "orbit", "--frames", "2"}, environment);
    CHECK_MESSAGE(outcome.code == 0, outcome.err);
    CHECK(fs::exists(out / "orbit_0001.png"));
    CHECK(fs::exists(out / "orbit.gif"));
    return outcome.err;
  };
  const std::string path = "PATH=" + bin.string();
  CHECK(contains(render({path}), "ffmpeg is not in PATH (apt-get install ffmpeg)"));
  write_text(bin / "ffmpeg", R"sh(#!/bin/sh
echo "$@" > "$CALLS"
[ -z "$FAIL" ] || { echo "Unknown encoder" >&2; exit 8; }
for film; do :; done
echo film > "$film"
)sh");
  fs::permissions(bin / "ffmpeg", fs::perms::owner_all);
  const std::string failed = render({path, "CALLS=" + calls.string(), "FAIL=1"});
  CHECK(contains(failed, "warning: "));
  CHECK(contains(failed, "ended with code 8; it printed:\n    Unknown encoder"));
  CHECK_FALSE(fs::exists(out / "orbit.mp4"));
  CHECK(contains(render({path, "CALLS=" + calls.string()}), "orbit.gif and orbit.mp4"));
  CHECK(content_of(out / "orbit.mp4") == "film\n");
  CHECK(contains(content_of(calls), "100 %% films/orbit_%04d.png -frames:v 2"));
  CHECK(std::distance(fs::directory_iterator(out), fs::directory_iterator()) == 4);  // no temporary file stayed
}

TEST_CASE("a film by ffmpeg itself") {
  if (!fs::exists("/usr/bin/ffmpeg")) {
    MESSAGE("skipped: no ffmpeg");
    return;
  }
  const fs::path out = scratch() / "100% film: one";
  REQUIRE(cloam_with(
              {"render", trained().string(), "-o", out.string(), "--path", "orbit", "--frames", "3", "--size", "25x31"})
              .code == 0);
  CHECK(content_of(out / "orbit.mp4").substr(4, 4) == "ftyp");
  const fs::path stated = scratch() / "film-stated";
  REQUIRE(std::system(("ffprobe -v error -count_frames -show_entries stream=codec_name,width,height,pix_fmt,"
                       "color_space,r_frame_rate,nb_read_frames -of default=noprint_wrappers=1 '" +
                       (out / "orbit.mp4").string() + "' > " + stated.string())
                          .c_str()) == 0);
  for (const char* line : {"codec_name=h264\n", "width=24\n", "height=30\n", "pix_fmt=yuv420p\n", "color_space=bt709\n",
                           "r_frame_rate=20/1\n", "nb_read_frames=3\n"})
    CHECK_MESSAGE(contains(content_of(stated), line), line, content_of(stated));
}

TEST_CASE("a camera file gives the view, and a damaged one is exit 3") {
  const auto source = json_of(small_scene() / "transforms_test.json");
  nlohmann::json camera = {{"w", 20}, {"h", 10}, {"camera_angle_x", 0.7}};
  camera["transform_matrix"] = source.at("frames")[0].at("transform_matrix");
  write_text(scratch() / "cam.json", camera.dump());
  const fs::path out = scratch() / "camera";
  REQUIRE(cloam_with({"render", trained().string(), "-o", out.string(), "--camera", (scratch() / "cam.json").string()})
              .code == 0);
  CHECK(read_image(out / "camera_0000.png").width == 20);
  CHECK(read_image(out / "camera_0000.png").height == 10);
  CHECK_FALSE(fs::exists(out / "camera.gif"));  // one picture is no film
  camera["frames"] = nlohmann::json::array();
  for (const auto& frame : source.at("frames"))
    camera["frames"].push_back({{"transform_matrix", frame.at("transform_matrix")}});
  write_text(scratch() / "path.json", camera.dump());
  REQUIRE(cloam_with({"render", trained().string(), "-o", out.string(), "--camera", (scratch() / "path.json").string()})
              .code == 0);
  const std::string gif = content_of(out / "camera.gif");
  CHECK(std::count(gif.begin(), gif.end(), '\x2c') >= 2);
  CHECK(read_image(out / "camera_0001.png").width == 20);
  camera.erase("frames");
  camera.erase("transform_matrix");
  write_text(scratch() / "cam.json", camera.dump());
  CHECK(cloam_with({"render", trained().string(), "-o", out.string(), "--camera", (scratch() / "cam.json").string()})
            .code == 3);
}

TEST_CASE("distance: a set is as itself and as its pictures on white, other pictures are further") {
  const fs::path photos = small_scene() / "train", on_white = scratch() / "on_white", one = scratch() / "one_picture";
  for (const auto& entry : fs::directory_iterator(photos)) {
    const Image image = read_image(entry.path());
    REQUIRE(image.channels == 4);
    Image flat{image.width, image.height, 3, {}};
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
      const double alpha = image.pixels[i / 4 * 4 + 3] / 255.0;
      if (i % 4 < 3) flat.pixels.push_back(std::uint8_t(std::lround(image.pixels[i] * alpha + 255 * (1 - alpha))));
    }
    write_png(on_white / entry.path().filename(), flat);
    write_png(one / "picture.png", flat);
  }
  const auto measured = [&](const fs::path& a, const fs::path& b) {
    const Outcome outcome = cloam_with({"distance", a.string(), b.string(), "--features", "random", "--json"});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return nlohmann::json::parse(outcome.out);
  };
  const auto same = measured(photos, on_white), other = measured(photos, small_scene() / "test");
  CHECK(same.at("schema_version") == 1);
  CHECK(same.at("feature_network") == "random features");
  CHECK(other.at("set_images") == std::vector<int>{8, 2});
  const double apart = other.at("frechet_feature_distance").get<double>();
  CHECK(apart > 0);
  CHECK(std::abs(same.at("frechet_feature_distance").get<double>()) < 1e-6 * apart);
  CHECK(other.at("kernel_feature_distance").is_number());
  const Outcome lonely = cloam_with({"distance", photos.string(), one.string(), "--features", "random"});
  CHECK(lonely.code == 3);
  CHECK(contains(lonely.err, "one_picture: at least two images"));
  CHECK(cloam_with({"distance", photos.string(), photos.string(), "--features", photos.string()}).code == 3);
}
