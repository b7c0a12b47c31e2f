// LLFF's captures against cameras known here; damage; and what takes their depths.
#include "models/data/llff.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>

#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/forward_facing.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

std::vector<double> numbers_of(const ForwardFacing& made) {
  std::vector<double> numbers;
  for (const auto& seat : made.seats) {
    const std::vector<double> row = made.row(seat);
    numbers.insert(numbers.end(), row.begin(), row.end());
  }
  return numbers;
}

std::string plain(const std::vector<double>& numbers) {
  return npy_bytes("<f8", std::to_string(numbers.size() / 17) + ", 17", bytes_of_numbers<double>(numbers));
}

void write_images(const fs::path& folder, const ForwardFacing& made, int shrink = 1) {
  fs::create_directories(folder);
  for (std::size_t i = 0; i < made.seats.size(); ++i) {
    Image image{made.width / shrink, made.height / shrink, 3, {}};
    image.pixels.assign(static_cast<std::size_t>(image.width * image.height * 3), static_cast<std::uint8_t>(10 * i));
    write_png(folder / ("IMG_" + std::to_string(100 + i) + ".png"), image);
  }
}

struct Llff : Folder {
  ForwardFacing made;
  Llff() {
    write_images(path / "images", made);
    write_text(path / "poses_bounds.npy", plain(numbers_of(made)));
  }
  std::string error_with(const std::string& npy) const {
    write_text(path / "poses_bounds.npy", npy);
    return error_of([&] { read_scene(path); });
  }
};

}  // namespace

TEST_CASE("LLFF: poses, intrinsics and depths are those of the cameras") {
  const Llff capture;
  const Scene scene = read_scene(capture.path);
  CHECK(scene.format == "LLFF");
  CHECK(scene.warnings.empty());
  CHECK(scene.hints.nearest == 2.0);
  REQUIRE(scene.frames.size() == 20);
  CHECK(scene.frames_listed == 20);
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.up.dot(Eigen::Vector3d::UnitY()) > 0.999);
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    const auto& seat = capture.made.seats[i];
    CHECK(scene.frames[i].image == "images/IMG_" + std::to_string(100 + i) + ".png");
    CHECK(scene.frames[i].split == Split::train);
    // A point that OpenGL's formula sees at a pixel.
    const Eigen::Vector3d point(0.3, -0.2, -5),
        in_gl(seat.right.dot(point - seat.place), seat.up.dot(point - seat.place), seat.back.dot(point - seat.place));
    const Eigen::Vector2d pixel(24 - 44 * in_gl.x() / in_gl.z(), 18 + 44 * in_gl.y() / in_gl.z());
    const Eigen::Isometry3d world_from_camera(scene.frames[i].world_from_camera);
    CHECK((project(scene.cameras[0], world_from_camera.inverse() * point) - pixel).norm() < 1e-9);
  }
}

TEST_CASE("LLFF: smaller images stand in for those that are not there; other orders and types read the same") {
  const Llff capture;
  fs::remove_all(capture.path / "images");
  write_images(capture.path / "images_4", capture.made, 4);
  const Scene small = read_scene(capture.path);
  CHECK(small.frames[3].image == "images_4/IMG_103.png");
  CHECK(small.cameras.at(0).width == 12);
  CHECK(small.cameras.at(0).fx == doctest::Approx(11));
  CHECK(small.cameras.at(0).cy == doctest::Approx(4.5));

  const std::vector<double> numbers = numbers_of(capture.made);
  std::vector<double> turned;
  for (std::size_t column = 0; column < 17; ++column)
    for (std::size_t row = 0; row < 20; ++row) turned.push_back(numbers[17 * row + column]);
  for (const std::string& npy : {npy_bytes("<f8", "20, 17", bytes_of_numbers<double>(turned), true),
                                 npy_bytes("<f4", "20, 17", bytes_of_numbers<float>(numbers))}) {
    write_text(capture.path / "poses_bounds.npy", npy);
    const Scene same = read_scene(capture.path);
    for (std::size_t i = 0; i < 20; ++i)
      CHECK((same.frames[i].world_from_camera - small.frames[i].world_from_camera).norm() < 1e-6);
  }
}

TEST_CASE("LLFF: what is wrong is named, with the mend") {
  const Llff capture;
  const std::vector<double> numbers = numbers_of(capture.made);
  const std::string sound = plain(numbers);
  const auto changed = [&](std::size_t place, double value) {
    std::vector<double> other = numbers;
    other[place] = value;
    return capture.error_with(plain(other));
  };
  std::string error = capture.error_with(npy_bytes("<f8", "17, 20", bytes_of_numbers<double>(numbers)));
  CHECK_MESSAGE(holds(error, "found <f8 of shape (17, 20)"), error);
  CHECK(holds(error, "fix: write it again with LLFF's imgs2poses.py"));
  CHECK(holds(capture.error_with(npy_bytes("<f8", "340", bytes_of_numbers<double>(numbers))),
              "found <f8 of shape (340)"));
  CHECK(holds(capture.error_with(npy_bytes("<f8", "0, 17", "")), "shape (0, 17)"));
  for (const std::size_t length : {std::size_t{0}, std::size_t{5}, std::size_t{60}, sound.size() - 8})
    CHECK(holds(capture.error_with(sound.substr(0, length)), "poses_bounds.npy"));
  CHECK(holds(capture.error_with(sound + "more"), "poses_bounds.npy"));
  CHECK(holds(capture.error_with(npy_bytes("|O", "20, 17", "pickle")), "poses_bounds.npy"));
  error = capture.error_with(plain(std::vector<double>(numbers.begin(), numbers.end() - 17)));
  CHECK_MESSAGE(holds(error, "poses_bounds.npy has 19 poses, images/ has 20 images"), error);
  CHECK(holds(changed(17, 3), "row 1 (IMG_101.png): the pose"));  // no rotation
  CHECK(holds(changed(34, std::nan("")), "row 2 (IMG_102.png): a number of the pose is not finite"));
  CHECK(holds(changed(15, 0), "looked for depths 0 < near <= far, found 0 and 12"));
  CHECK(holds(changed(16, 1), "found 2 and 1"));
  error = changed(4, 30);  // the height
  CHECK_MESSAGE(holds(error, "the pose is of an image of 48x30 pixels"), error);
  CHECK(holds(error, "found 48x36"));
  CHECK(holds(changed(14, -3), "focal length -3"));
  fs::remove_all(capture.path / "images");
  CHECK(holds(capture.error_with(sound), "looked for images/, images_2/, images_4/ and images_8/"));
}

TEST_CASE("LLFF: a row that is damaged can be skipped") {
  const Llff capture;
  std::vector<double> numbers = numbers_of(capture.made);
  numbers[34] = std::nan("");
  write_text(capture.path / "poses_bounds.npy", plain(numbers));
  ReadOptions options;
  options.skip_bad = true;
  const Scene scene = read_scene(capture.path, options);
  CHECK(scene.frames.size() == 19);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "IMG_102.png"));
}

TEST_CASE("a COLMAP model beside LLFF's file gives the poses, the file the depths") {
  const Llff capture;
  write_text(capture.path / "sparse/0/cameras.txt", "1 PINHOLE 48 36 44 44 24 18\n");
  write_text(capture.path / "sparse/0/images.txt",
             "1 1 0 0 0 0 0 0 1 IMG_100.png\n\n2 1 0 0 0 1 0 0 1 IMG_101.png\n\n");
  const Scene scene = read_scene(capture.path);
  CHECK(scene.format == "COLMAP");
  CHECK(scene.frames.size() == 2);
  CHECK(scene.hints.nearest == 2.0);
  write_text(capture.path / "poses_bounds.npy", "no array");
  const Scene other = read_scene(capture.path);
  CHECK(!other.hints.nearest);
  CHECK(holds(other.warnings.back(), "depths left out: "));
}
