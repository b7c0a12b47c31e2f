// Masks by their names and in both meanings, and images that EXIF says are turned.
#include <doctest/doctest.h>

#include <fstream>

#include "models/data/load_images.h"
#include "models/data/photos.h"
#include "models/data/read_scene.h"
#include "models/io/bytes.h"
#include "models/io/image.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

void make_image(const fs::path& path, int width, int height, std::uint8_t value, int channels = 3) {
  fs::create_directories(path.parent_path());
  write_png(path, {width, height, channels, std::vector<std::uint8_t>(std::size_t(channels) * width * height, value)});
}

// COLMAP's model of two pinholes of 4x2 pixels at the origin.
void make_capture(const fs::path& root, const std::string& first, const std::string& second) {
  fs::create_directories(root / "sparse/0");
  std::ofstream(root / "sparse/0/cameras.txt") << "1 PINHOLE 4 2 4 4 2 1\n";
  std::ofstream(root / "sparse/0/images.txt")
      << "1 1 0 0 0 0 0 0 1 " << first << "\n\n2 1 0 0 0 0 0 1 1 " << second << "\n\n";
}

// The EXIF block of a camera that was held in that way: a TIFF header and one entry, tag 0x112.
void set_orientation(const fs::path& jpeg, int orientation) {
  const auto bytes = read_file(jpeg, 1 << 20);
  std::string content(bytes.begin(), bytes.end());
  const std::string tiff{'I', 'I', '*', 0, 8, 0, 0, 0, 1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0, static_cast<char>(orientation),
                         0,   0,   0,   0, 0, 0, 0};
  const std::string body = std::string("Exif\0\0", 6) + tiff;
  const auto length = static_cast<char>(body.size() + 2);
  content.insert(2, std::string{'\xff', '\xe1', 0, length} + body);
  std::ofstream(jpeg, std::ios::binary) << content;
}

// Grey values by place, far enough apart for JPEG.
Image ramp(int width, int height) {
  Image image{width, height, 1, {}};
  for (int row = 0; row < height; ++row) {
    for (int column = 0; column < width; ++column)
      image.pixels.push_back(static_cast<std::uint8_t>(20 + 100 * row / height + 100 * column / width));
  }
  return image;
}

}  // namespace

TEST_CASE("masks beside images/ are found by COLMAP's and by plain names") {
  const Folder folder;
  make_capture(folder.path, "a.png", "left/b.jpeg.png");
  make_image(folder.path / "images/a.png", 4, 2, 90);
  make_image(folder.path / "images/left/b.jpeg.png", 4, 2, 90);
  make_image(folder.path / "masks/a.png.png", 4, 2, 255, 1);
  make_image(folder.path / "masks/a.png", 4, 2, 0, 1);
  const Scene some = read_scene(folder.path);
  CHECK(some.frames.at(0).mask == "masks/a.png.png");
  CHECK_FALSE(some.frames.at(1).mask);
  REQUIRE(some.warnings.size() == 1);
  CHECK(holds(some.warnings[0], "1 of 2 images have no mask in masks/: images/left/b.jpeg.png"));
  make_image(folder.path / "masks/left/b.jpeg.png", 4, 2, 255, 1);
  const Scene all = read_scene(folder.path);
  CHECK(all.frames.at(1).mask == "masks/left/b.jpeg.png");
  CHECK(all.warnings.empty());
  CHECK(find_mask(folder.path, "images/x.jpg") == std::nullopt);
  make_image(folder.path / "masks/x.png", 4, 2, 255, 1);
  CHECK(find_mask(folder.path, "images/x.jpg") == "masks/x.png");
  CHECK(find_mask(folder.path, "x.jpg") == "masks/x.png");
}

TEST_CASE("black in a mask takes no part, or is empty background") {
  const Folder folder;
  make_capture(folder.path, "a.png", "b.png");
  make_image(folder.path / "images/a.png", 4, 2, 90);
  make_image(folder.path / "images/b.png", 4, 2, 90);
  make_image(folder.path / "masks/b.png", 4, 2, 255, 1);
  write_png(folder.path / "masks/a.png", {4, 2, 1, {255, 255, 0, 255, 255, 255, 0, 255}});
  const Scene scene = read_scene(folder.path);
  const Pixels ignored = load_images(scene, Split::train, {2, false, MaskMeaning::ignore});
  CHECK(ignored.frames.at(0).mask == std::vector<std::uint8_t>{255, 0});
  CHECK(ignored.frames[0].rgba == std::vector<std::uint8_t>{90, 90, 90, 255, 90, 90, 90, 255});
  CHECK_FALSE(ignored.has_alpha);
  const Pixels empty = load_images(scene, Split::train, {2, false, MaskMeaning::transparent});
  CHECK(empty.frames.at(0).mask.empty());
  CHECK(empty.frames[0].rgba == std::vector<std::uint8_t>{90, 90, 90, 255, 90, 90, 90, 128});
  CHECK(empty.frames.at(1).rgba == std::vector<std::uint8_t>{90, 90, 90, 255, 90, 90, 90, 255});
  CHECK(empty.has_alpha);
}

TEST_CASE("the rows that show the recording car are ignored, with a mask and without") {
  const Folder folder;
  make_image(folder.path / "a.png", 4, 10, 90);
  make_image(folder.path / "mask.png", 4, 10, 255);
  Scene scene;
  scene.root = folder.path;
  scene.cameras = {{4, 10, 4, 4, 2, 5}};
  scene.frames.resize(2);
  for (Frame& frame : scene.frames) frame.name = frame.image = "a.png", frame.ego_rows = 0.25;
  scene.frames[1].mask = "mask.png";
  for (const int factor : {1, 2}) {
    CAPTURE(factor);
    const Pixels pixels = load_images(scene, Split::train, {.downscale = factor});
    for (const FramePixels& frame : pixels.frames) {
      REQUIRE(frame.mask.size() == std::size_t(frame.width * frame.height));
      // From row 7.5 of 10 on, and every reduced row that holds a part of those.
      const int first = factor == 1 ? 7 : 3;
      for (int row = 0; row < frame.height; ++row)
        for (int column = 0; column < frame.width; ++column)
          CHECK(frame.mask[std::size_t(row * frame.width + column)] == (row < first ? 255 : 0));
    }
  }
}

TEST_CASE("an image is turned and mirrored as each EXIF orientation says") {
  // The standard's own figure: where the stored rows (0, 1) and columns (0 to 2) end up.
  const Image stored{3, 2, 1, {1, 2, 3, 4, 5, 6}};
  const std::vector<std::uint8_t> appearance[] = {{1, 2, 3, 4, 5, 6}, {3, 2, 1, 6, 5, 4}, {6, 5, 4, 3, 2, 1},
                                                  {4, 5, 6, 1, 2, 3}, {1, 4, 2, 5, 3, 6}, {4, 1, 5, 2, 6, 3},
                                                  {6, 3, 5, 2, 4, 1}, {3, 6, 2, 5, 1, 4}};
  for (int orientation = 1; orientation <= 8; ++orientation) {
    CAPTURE(orientation);
    const Image seen = upright(stored, orientation);
    CHECK(seen.width == (orientation < 5 ? 3 : 2));
    CHECK(seen.height == (orientation < 5 ? 2 : 3));
    CHECK(seen.pixels == appearance[orientation - 1]);
  }
}

TEST_CASE("photos are turned where the capture lists the turned size, and else used as stored") {
  const Folder folder;
  fs::create_directories(folder.path / "images");
  const Image photo = ramp(32, 16);
  write_jpeg(folder.path / "images/a.jpg", photo);
  set_orientation(folder.path / "images/a.jpg", 6);
  CHECK(read_image(folder.path / "images/a.jpg").orientation == 6);
  CHECK(read_image(folder.path / "images/a.jpg").width == 32);
  const auto load = [&](const std::string& size) {
    std::ofstream(folder.path / "transforms.json")
        << R"({"fl_x":20,)" << size
        << R"(,"frames":[{"file_path":"images/a.jpg","transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]})";
    return load_images(read_scene(folder.path), Split::train);
  };
  const auto near = [](std::uint8_t a, std::uint8_t b) { return std::abs(a - b) < 12; };
  const Pixels turned = load(R"("w":16,"h":32)");
  CHECK(turned.frames.at(0).width == 16);
  CHECK(turned.cameras.at(0).height == 32);
  CHECK(near(turned.frames[0].rgba[0], photo.pixels[15 * 32]));  // top left: what was stored at the bottom left
  CHECK(near(turned.frames[0].rgba[4 * 15], photo.pixels[0]));
  REQUIRE(turned.warnings.size() == 1);
  CHECK(holds(turned.warnings[0], "1 images (images/a.jpg, ...) are rotated"));
  const Pixels stored = load(R"("w":32,"h":16)");
  CHECK(stored.frames.at(0).width == 32);
  CHECK(near(stored.frames[0].rgba[0], photo.pixels[0]));
  REQUIRE(stored.warnings.size() == 1);
  CHECK(holds(stored.warnings[0], "is ignored"));
  const Pixels small = load(R"("w":8,"h":16)");  // another size of the same camera
  CHECK(small.frames.at(0).width == 16);
  CHECK(small.warnings.size() == 2);
  CHECK_THROWS_AS(load(R"("w":30,"h":32)"), Error);

  make_image(folder.path / "masks/a.png", 16, 32, 0, 1);  // a mask of what is seen, and one of what is stored
  CHECK(load(R"("w":16,"h":32)").frames.at(0).mask == std::vector<std::uint8_t>(16 * 32, 0));
  write_png(folder.path / "masks/a.png", {32, 16, 1, [] {
                                            std::vector<std::uint8_t> mask(32 * 16, 255);
                                            mask[15 * 32] = 0;  // the bottom left
                                            return mask;
                                          }()});
  CHECK(load(R"("w":16,"h":32)").frames.at(0).mask.at(0) == 0);
  CHECK(load(R"("w":16,"h":32)").frames.at(0).mask.at(1) == 255);
}

TEST_CASE("half a turn shows in no size: it is told and not followed") {
  const Folder folder;
  fs::create_directories(folder.path / "images");
  write_jpeg(folder.path / "images/a.jpg", ramp(4, 2));
  write_jpeg(folder.path / "images/b.jpg", ramp(4, 2));
  set_orientation(folder.path / "images/b.jpg", 3);
  make_capture(folder.path, "a.jpg", "b.jpg");
  const Pixels pixels = load_images(read_scene(folder.path), Split::train);
  CHECK(pixels.frames.at(0).rgba == pixels.frames.at(1).rgba);
  REQUIRE(pixels.warnings.size() == 1);
  CHECK(holds(pixels.warnings[0], "1 images (images/b.jpg, ...) have an EXIF orientation"));
}
