// Crops of objects: the photo's pixels where the mask is, in files that say what they are.
#include "models/eval/object_crops.h"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <nlohmann/json.hpp>

#include "models/data/read_scene.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "models/synth/street_log.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

const Listener kSilent = {[](const std::string&) {}, [](const std::string&) {}, [](const auto&) {}};

/// A made street of three moments with the truth beside it.
const fs::path& street() {
  static const Folder folder;
  static const bool made = [] {
    write_street_log(folder.path / "log 1", {.frames = 3, .width = 160, .height = 90, .seed = 4});
    return true;
  }();
  (void)made;
  static const fs::path path = folder.path / "log 1";
  return path;
}

CropRequest request_of(const fs::path& out, int size = 64) {
  CropRequest request;
  request.logs = {street().string()};
  request.out = out.string();
  request.size = size;
  return request;
}

Image ramp(int width, int height) {
  Image image{width, height, 3, {}};
  for (int row = 0; row < height; ++row)
    for (int column = 0; column < width; ++column)
      for (const int value : {8 * column, 8 * row, 100}) image.pixels.push_back(static_cast<std::uint8_t>(value));
  return image;
}

}  // namespace

TEST_CASE("an image at another size: the same one, ramps that stay, colours that clear pixels do not touch") {
  const Image same = ramp(24, 16);
  CHECK(resized(same, 24, 16).pixels == same.pixels);
  const Image larger = resized(same, 72, 64);  // three times as wide, four times as high
  for (int row = 4; row < 60; ++row)
    for (int column = 3; column < 69; ++column) {
      const std::uint8_t* pixel = &larger.pixels[3 * std::size_t(72 * row + column)];
      CHECK(std::abs(pixel[0] - 8 * ((column + 0.5) / 3 - 0.5)) <= 0.5);
      CHECK(std::abs(pixel[1] - 8 * ((row + 0.5) / 4 - 0.5)) <= 0.5);
      CHECK(pixel[2] == 100);
    }
  const Image smaller = resized(same, 8, 4);
  CHECK(smaller.pixels[3 * (8 * 1 + 4)] == 8 * (4 * 3 + 1));        // the middle of columns 12 to 14
  CHECK(smaller.pixels[3 * (8 * 2 + 4) + 1] == 8 * (2 * 4 + 1.5));  // of rows 8 to 11
  const Image stripes{9, 1, 1, {0, 255, 0, 0, 255, 0, 0, 255, 0}};
  CHECK(resized(stripes, 3, 1).pixels[1] == 85);  // not the 255 of the pixel at the middle
  // Red that is seen beside green that is not.
  const Image edge = resized({2, 1, 4, {200, 0, 0, 255, 0, 200, 0, 0}}, 4, 1);
  CHECK(edge.pixels == std::vector<std::uint8_t>{200, 0, 0, 255, 200, 0, 0, 191, 200, 0, 0, 64, 0, 0, 0, 0});
}

TEST_CASE("a cut-out has the photo's pixels where the mask is, and nothing elsewhere or beyond the image") {
  FramePixels photo{0, 0, 6, 4, {}, {}};
  for (int i = 0; i < 24; ++i)
    for (const int value : {i, 50 + i, 100 + i, 255}) photo.rgba.push_back(static_cast<std::uint8_t>(value));
  ActorMask mask{6, 4, std::vector<int>(24)};
  mask.actors[6 * 1 + 4] = mask.actors[6 * 0 + 5] = 3;
  mask.actors[6 * 1 + 5] = 2;  // another actor
  ObjectView object;
  object.actor = 2;
  object.square = {3, -1, 7, 3};
  const Image crop = cut_out(photo, mask, object);
  REQUIRE(crop.width == 4);
  REQUIRE(crop.height == 4);
  std::vector<std::uint8_t> expected(4 * 16);
  const auto put = [&](int column, int row, int value) {
    const int values[] = {value, 50 + value, 100 + value, 255};
    for (int c = 0; c < 4; ++c)
      expected[4 * std::size_t(4 * row + column) + std::size_t(c)] = static_cast<std::uint8_t>(values[c]);
  };
  put(1, 2, 10);
  put(2, 1, 5);
  CHECK(crop.pixels == expected);
}

TEST_CASE("crops of a log are its photos' pixels, upright, with the mask as alpha; the index describes each") {
  const Folder folder;
  const CropReport report = write_crops(request_of(folder.path / "all"), kSilent);
  const Json index = parse_json_file(folder.path / "all/crops.json");
  const Json& crops = index.at("crops");
  REQUIRE(crops.size() > 5);
  CHECK(index.at("counts").at("kept") == crops.size());
  CHECK(files_in(folder.path / "all") == crops.size() + 1);
  CHECK(report.images == 6);
  CHECK(report.mask_files == 6);
  const Json numbers = parse_json_file(street() / "truth/actors.json");
  for (std::size_t i = 0; i < crops.size(); i += 4) {
    const Json& crop = crops[i];
    const std::string file = crop.at("file"), camera = crop.at("camera"), image = crop.at("image");
    CAPTURE(file);
    CHECK(file.starts_with("log_1_" + camera + "_0" + std::to_string(crop.at("step").get<int>()) + "_"));
    CHECK(read_image_size(folder.path / "all" / file).width == 64);
    // At its own size it is not resampled: compare it with photo and mask as they lie on the disk.
    const std::vector<int> square = crop.at("square"), box = crop.at("box");
    const int side = square[2] - square[0];
    if (side < 16) continue;
    const fs::path own = folder.path / std::to_string(i);
    write_crops(request_of(own, side), kSilent);
    const Image cut = read_image(own / file), photo = read_image(street() / image);
    const Labels labels = read_labels(street() / "truth" / camera / (fs::path(image).stem().string() + "_actor.png"));
    REQUIRE(cut.width == side);
    REQUIRE(cut.channels == 4);
    int wrong = 0, opaque = 0;
    for (int row = 0; row < side; ++row)
      for (int column = 0; column < side; ++column) {
        const int x = square[0] + column, y = square[1] + row;
        const bool shown = x >= 0 && x < 160 && y >= 0 && y < 90;
        const std::size_t from = shown ? std::size_t(160 * y + x) : 0;
        const std::string number = std::to_string(labels.values[from]);
        const bool is_actor = shown && numbers.contains(number) && numbers.at(number) == crop.at("actor");
        const std::uint8_t* pixel = &cut.pixels[4 * std::size_t(side * row + column)];
        for (std::size_t c = 0; c < 3; ++c) wrong += pixel[c] != (is_actor ? photo.pixels[3 * from + c] : 0);
        wrong += pixel[3] != (is_actor ? 255 : 0);
        opaque += is_actor;
      }
    CHECK(wrong == 0);
    CHECK(crop.at("pixels") == opaque);
    CHECK(opaque >= 100);
    CHECK((square[0] <= box[0] && square[1] <= box[1] && square[2] >= box[2] && square[3] >= box[3]));
  }
}

TEST_CASE("pose and intrinsics of a crop project the box's centre and corners where the crop shows it") {
  const Folder folder;
  write_crops(request_of(folder.path / "crops", 128), kSilent);
  int sides = 0;
  const Json crops = parse_json_file(folder.path / "crops/crops.json").at("crops");
  for (const Json& crop : crops) {
    const std::vector<int> box = crop.at("box"), square = crop.at("square");
    const Eigen::Matrix4d camera_from_box = matrix4(crop, "box_from_camera", "crop").inverse();
    const std::vector<double> size = crop.at("size_m");
    const Json& lens = crop.at("intrinsics");
    Eigen::Vector2d least(1e9, 1e9), most(-1e9, -1e9);
    double nearest = 1e9;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector4d at((corner & 1 ? 0.5 : -0.5) * size[0], (corner & 2 ? 0.5 : -0.5) * size[1],
                               (corner & 4 ? 0.5 : -0.5) * size[2], 1);
      const Eigen::Vector3d seen = (camera_from_box * at).head<3>();
      nearest = std::min(nearest, seen.z());
      const Eigen::Vector2d pixel(lens.at("fx").get<double>() * seen.x() / seen.z() + lens.at("cx").get<double>(),
                                  lens.at("fy").get<double>() * seen.y() / seen.z() + lens.at("cy").get<double>());
      least = least.cwiseMin(pixel), most = most.cwiseMax(pixel);
    }
    if (nearest < 0.1) continue;                           // partly behind the camera
    const double scale = 128.0 / (square[2] - square[0]);  // a pixel of the photo
    const auto check = [&](double bound, int pixel, int start, int image_end) {
      if (pixel == 0 || pixel == image_end) return;  // cut off by the image
      CHECK(std::abs(bound - scale * (pixel - start)) <= scale);
      ++sides;
    };
    check(least.x(), box[0], square[0], 160);
    check(least.y(), box[1], square[1], 90);
    check(most.x(), box[2], square[0], 160);
    check(most.y(), box[3], square[1], 90);
  }
  CHECK(sides > 10);
}

TEST_CASE("equal requests give equal bytes; a split takes its images alone") {
  const Folder folder;
  write_crops(request_of(folder.path / "a"), kSilent);
  write_crops(request_of(folder.path / "b"), kSilent);
  for (const auto& entry : fs::directory_iterator(folder.path / "a"))
    CHECK(content_of(entry.path()) == content_of(folder.path / "b" / entry.path().filename()));
  CropRequest request = request_of(folder.path / "test");
  request.how.protocol.name = "novel";
  request.split = "test";
  write_crops(request, kSilent);
  const Json crops = parse_json_file(folder.path / "test/crops.json").at("crops");
  REQUIRE(!crops.empty());
  for (const Json& crop : crops) CHECK(crop.at("camera") == "front_left_camera");
}

TEST_CASE("without mask files the boxes stand for actors, which is counted and told") {
  const Folder folder;
  fs::copy(street(), folder.path / "log", fs::copy_options::recursive);
  fs::remove(folder.path / "log/truth/actors.json");
  CropRequest request = request_of(folder.path / "crops");
  request.logs = {(folder.path / "log").string()};
  std::string warnings;
  Listener listener = kSilent;
  listener.warn = [&](const std::string& line) { warnings += line + "\n"; };
  const CropReport report = write_crops(request, listener);
  CHECK(report.images == 6);
  CHECK(report.mask_files == 0);
  CHECK_MESSAGE(holds(warnings, "log: 6 of 6 images have no mask file"), warnings);
  CHECK(parse_json_file(folder.path / "crops/crops.json").at("crops").at(0).at("mask") == "box");
}

TEST_CASE("masks of several logs lie in folders of their names, those of one log may lie alone") {
  const Folder folder;
  const fs::path masks = folder.path / "sam";
  fs::create_directories(masks);
  fs::copy(street() / "truth", masks / "log 1", fs::copy_options::recursive);
  CropRequest request = request_of(folder.path / "named");
  request.masks = masks.string();
  CHECK(write_crops(request, kSilent).mask_files == 6);
  request.out = (folder.path / "alone").string();
  request.masks = (masks / "log 1").string();
  CHECK(write_crops(request, kSilent).mask_files == 6);
  request.out = (folder.path / "none").string();
  request.masks = folder.path.string();
  const std::string told = error_of([&] { write_crops(request, kSilent); });
  CHECK_MESSAGE(holds(told, "no " + (folder.path / "actors.json").string() + "; want {"), told);
  CHECK_FALSE(fs::exists(folder.path / "none"));
}
