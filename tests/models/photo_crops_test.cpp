// Crops as references: which of a folder count, which logs are held out, and the cameras that look as they did.
#include "models/eval/photo_crops.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <set>

#include "models/io/commit.h"
#include "models/scene/box_projection.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

/// A camera 10 m behind a box of 2 x 4 x 1.5 m, that looks along it: x right, y down, z forward.
Eigen::Matrix4d from_behind(double distance = 10) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  pose(1, 3) = -distance;
  return pose;
}

/// What `cloam crops` says of that box: its near face is 8 m away, so that with a focal length of 400 pixels the bounds
/// are 100 x 75 pixels about the middle (200, 150) of the photo; the square is 110 pixels wide.
nlohmann::json whole_crop() {
  nlohmann::json crop = {{"file", "a.png"},
                         {"log", "001"},
                         {"class", "Car"},
                         {"night", true},
                         {"mask", "file"},
                         {"covered", 0.02},
                         {"box", {150, 112, 250, 188}},
                         {"square", {145, 95, 255, 205}},
                         {"size_m", {2, 4, 1.5}}};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) crop["box_from_camera"][row][column] = from_behind()(row, column);
  const double scale = 64.0 / 110;
  crop["intrinsics"] = {{"fx", 400 * scale}, {"fy", 400 * scale}, {"cx", 55 * scale}, {"cy", 55 * scale}};
  return crop;
}

struct CropFolder : Folder {
  nlohmann::json index = {{"size", 64}, {"crops", nlohmann::json::array()}};
  void add(const std::string& key = "file", const nlohmann::json& value = "a.png") {
    nlohmann::json crop = whole_crop();
    crop[key] = value;
    index["crops"].push_back(crop);
  }
  PhotoCrops read() {
    commit_text(path / "crops.json", index.dump());
    return read_photo_crops(path);
  }
};

PhotoCrops of_logs(const std::vector<std::string>& logs) {
  PhotoCrops photos;
  for (const std::string& log : logs) {
    PhotoCrop crop;
    crop.log = log;
    photos.crops.push_back(crop);
  }
  return photos;
}

}  // namespace

TEST_CASE("photo crops: those count that show the whole of an actor, cut out and free") {
  CropFolder folder;
  folder.add();
  folder.add("box", {150, 112, 249, 188});  // a pixel of rounding
  folder.add("mask", "box");
  folder.add("covered", 0.1);
  folder.add("box", {150, 112, 230, 188});  // cut at the edge of the image
  folder.add("box", {150, 120, 250, 188});
  const PhotoCrops photos = folder.read();
  REQUIRE(photos.crops.size() == 2);
  CHECK(photos.left_out == 4);
  CHECK(photos.size == 64);
  const PhotoCrop& crop = photos.crops[0];
  CHECK(crop.file == folder.path / "a.png");
  CHECK((crop.asset_class == 0 && crop.night && crop.log == "001"));
  CHECK(crop.size == Eigen::Vector3d(2, 4, 1.5));
  CHECK(crop.box_from_camera == from_behind());
  CHECK(crop.camera.width == 64);
  CHECK(crop.camera.cx == doctest::Approx(32));
}

TEST_CASE("photo crops: what is no folder of crops, or damaged, is told with its place") {
  const auto fails = [](CropFolder& folder, const char* says) {
    CHECK_THROWS_WITH_AS(folder.read(), doctest::Contains(says), Error);
  };
  const Folder empty;
  CHECK_THROWS_WITH_AS(read_photo_crops(empty.path), doctest::Contains("found no crops.json"), Error);
  CropFolder one;
  one.add();
  fails(one, "1 of 1 crops show all of an actor");
  for (const auto& [key, value, says] :
       {std::tuple<const char*, nlohmann::json, const char*>{"class", "Lorry", "crop 0: \"class\" is Lorry"},
        {"size_m", {1, 2}, "\"size_m\" is not a list of 3 numbers"},
        {"size_m", {1, 2, 0}, "must be above 0"},
        {"square", {0, 0, 0, 0}, "\"square\""},
        {"file", "../a.png", "../a.png"},
        {"intrinsics", {{"fx", 0}, {"fy", 1}, {"cx", 1}, {"cy", 1}}, "fx and fy"},
        {"box_from_camera", 1, "box_from_camera"}}) {
    CropFolder folder;
    folder.add(key, value);
    fails(folder, says);
  }
  CropFolder large;
  large.index["size"] = 1e9;
  fails(large, "\"size\"");
}

TEST_CASE("photo crops: whole logs are held out, one in four") {
  std::vector<std::string> logs;
  for (int i = 0; i < 80; ++i) logs.push_back(std::to_string(i % 8));
  const PhotoCrops photos = of_logs(logs);
  const std::vector<bool> held_out = held_out_crops(photos, 1);
  std::set<std::string> out, in;
  for (std::size_t i = 0; i < 80; ++i) (held_out[i] ? out : in).insert(logs[i]);
  CHECK(out.size() == 2);
  CHECK(in.size() == 6);
  CHECK(held_out_crops(photos, 1) == held_out);
  std::set<std::vector<bool>> ways;
  for (uint64_t seed = 0; seed < 9; ++seed) ways.insert(held_out_crops(photos, seed));
  CHECK(ways.size() > 3);
  CHECK_THROWS_WITH_AS(held_out_crops(of_logs({"1", "2", "1"}), 1), doctest::Contains("of 2 logs, want three"), Error);
}

TEST_CASE("photo crops: a framed camera sees a box as its crop was cut, from the same place") {
  const Eigen::Vector3d size(2, 4, 1.5);
  Camera camera;
  camera.width = camera.height = 64, camera.fx = camera.fy = 30, camera.cx = 50, camera.cy = 10;
  const Camera found = framed(camera, from_behind(), size);
  const double scale = 64.0 / 110;
  CHECK(found.fx == doctest::Approx(400 * scale));
  CHECK(found.fy == doctest::Approx(400 * scale));
  CHECK(found.cx == doctest::Approx(32));
  CHECK(found.cy == doctest::Approx(32));
}

TEST_CASE("photo crops: an asset of twice the size is seen as large as the box was, in the same direction") {
  CropFolder folder;
  folder.add();
  folder.add();
  const PhotoCrop crop = folder.read().crops[0];
  const auto bounds = [&](const Eigen::Vector3d& size) {
    return bounds_in_image(crop.camera, pose_for(size, crop).inverse(), size);
  };
  CHECK(pose_for(crop.size, crop) == crop.box_from_camera);
  CHECK(bounds(2 * crop.size) == bounds(crop.size));
  CHECK(pose_for(2 * crop.size, crop)(1, 3) == doctest::Approx(-20));
}
