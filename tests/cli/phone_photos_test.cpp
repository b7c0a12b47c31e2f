// cloam process with photos as phones write them: turned by EXIF, of several lenses, HEIC. EXIF is written here byte by
// byte, and what "right, top" and the like mean is taken from its standard (Exif 2.3, tag 274).
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/io/words.h"
#include "tests/cli/process.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

/// A stand-in that notes what it is asked, and the lists that it is given.
struct Bench {
  explicit Bench(const std::string& name) : root(scratch() / name) {
    fs::create_directories(root / "bin");
    fs::create_directories(root / "photos");
    write_text(root / "bin/colmap", R"sh(#!/bin/sh
echo "$@" >> "$CALLS"
while [ $# -gt 0 ]; do
  case $1 in --image_list_path) sed 's/^/listed: /' "$2" >> "$CALLS" ;; esac
  shift
done
)sh");
    fs::permissions(root / "bin/colmap", fs::perms::owner_all);
  }
  Outcome process(const Words& more = {}) const {
    Words words = {"process", (root / "photos").string(), "-o", (root / "data").string()};
    words.insert(words.end(), more.begin(), more.end());
    fs::remove(root / "calls");
    return cloam_with(words,
                      {"PATH=" + (root / "bin").string() + ":/usr/bin:/bin", "CALLS=" + (root / "calls").string()});
  }
  std::string calls() const { return content_of(root / "calls"); }
  fs::path upright() const { return root / "data/colmap/upright"; }
  fs::path root;
};

void add_number(std::string& bytes, std::uint32_t value, int size) {
  for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> (8 * i));
}

void add_entry(std::string& bytes, int tag, int kind, std::uint32_t value) {
  add_number(bytes, static_cast<std::uint32_t>(tag), 2);
  add_number(bytes, static_cast<std::uint32_t>(kind), 2);
  add_number(bytes, 1, 4);
  add_number(bytes, value, 4);
}

/// APP1 of a JPEG file: the orientation and the focal length on 35 mm film.
std::string exif(int orientation, int focal_35) {
  std::string tiff = "II";
  add_number(tiff, 42, 2);
  add_number(tiff, 8, 4);
  add_number(tiff, 2, 2);
  add_entry(tiff, 274, 3, static_cast<std::uint32_t>(orientation));
  add_entry(tiff, 34665, 4, 38);
  add_number(tiff, 0, 4);
  add_number(tiff, 1, 2);
  add_entry(tiff, 41989, 3, static_cast<std::uint32_t>(focal_35));
  add_number(tiff, 0, 4);
  const std::size_t length = tiff.size() + 8;
  return std::string("\xff\xe1") + static_cast<char>(length >> 8) + static_cast<char>(length & 255) +
         std::string("Exif\0\0", 6) + tiff;
}

void write_photo(const fs::path& path, const Image& stored, int orientation, int focal_35 = 26) {
  write_jpeg(path, stored);
  std::string bytes = content_of(path);
  bytes.insert(2, exif(orientation, focal_35));
  std::ofstream(path, std::ios::binary) << bytes;
}

/// Smooth, and different from all of its turns and mirrors.
Image picture(int width, int height) {
  Image image{width, height, 3, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double u = x / double(width), v = y / double(height);
      for (const double value : {40 + 180 * u, 220 - 170 * v, 60 + 150 * u * v})
        image.pixels.push_back(static_cast<std::uint8_t>(value));
    }
  return image;
}

/// The pixels that a camera stores which writes this orientation: the side of the picture where its first row lies, and
/// that of its first column.
Image stored_as(const Image& image, int orientation) {
  const std::array<std::string, 8> sides = {"tl", "tr", "br", "bl", "lt", "rt", "rb", "lb"};
  const std::string side = sides[std::size_t(orientation - 1)];
  const bool across = side[0] == 'l' || side[0] == 'r';  // its rows are columns of the picture
  Image out{across ? image.height : image.width, across ? image.width : image.height, 3, {}};
  for (int row = 0; row < out.height; ++row)
    for (int column = 0; column < out.width; ++column) {
      int x = across ? row : column, y = across ? column : row;
      if (side[across ? 0 : 1] == 'r') x = image.width - 1 - x;
      if (side[across ? 1 : 0] == 'b') y = image.height - 1 - y;
      for (int c = 0; c < 3; ++c) out.pixels.push_back(image.pixels[std::size_t((y * image.width + x) * 3 + c)]);
    }
  return out;
}

double psnr(const Image& a, const Image& b) {
  REQUIRE(a.width == b.width);
  REQUIRE(a.height == b.height);
  double sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += std::pow(double(a.pixels[i]) - b.pixels[i], 2);
  return sum == 0 ? 99 : 10 * std::log10(255 * 255 / (sum / double(a.pixels.size())));
}

}  // namespace

TEST_CASE("photos of all eight orientations are the same picture to COLMAP") {
  const Bench bench("phone-turned");
  const Image truth = picture(96, 64);
  for (int orientation = 1; orientation <= 8; ++orientation)
    write_photo(bench.root / ("photos/more/" + std::to_string(orientation) + ".jpg"), stored_as(truth, orientation),
                orientation);
  const Outcome made = bench.process();
  CHECK(holds(made.err, "turning photos upright"));
  CHECK(holds(made.err, "8 photos, one camera"));
  for (int orientation = 1; orientation <= 8; ++orientation) {
    CAPTURE(orientation);
    const fs::path copy = bench.upright() / ("more/" + std::to_string(orientation) + ".jpg");
    REQUIRE(fs::exists(copy));
    const Image seen = read_image(copy);
    CHECK(seen.orientation == 1);
    CHECK(psnr(seen, truth) > 35);
    CHECK(holds(content_of(copy),
                std::string("\x05\xa4\x03\0\x01\0\0\0\x1a\0", 10)));  // the focal length of 26 mm is left
  }
  CHECK(holds(bench.calls(), "--image_path " + bench.upright().string()));
  CHECK(holds(bench.calls(), "--ImageReader.single_camera 1"));
  CHECK_FALSE(holds(bench.calls(), "listed"));
}

TEST_CASE("photos of several sizes or lenses have a camera each") {
  const Bench bench("phone-lenses");
  const fs::path photos = bench.root / "photos";
  write_photo(photos / "a.jpg", picture(96, 64), 1);
  write_photo(photos / "b.jpg", picture(96, 64), 1, 13);  // the other lens
  write_photo(photos / "c.jpg", picture(96, 64), 1);
  write_photo(photos / "d.jpg", picture(64, 96), 1);
  const Outcome made = bench.process();
  CHECK(holds(made.err, "4 photos, 3 cameras"));
  CHECK_FALSE(fs::exists(bench.upright()));
  CHECK(holds(bench.calls(), "listed: a.jpg\nlisted: c.jpg\nfeature_extractor"));
  CHECK(holds(bench.calls(), "listed: b.jpg\nfeature_extractor"));
  CHECK(holds(bench.calls(), "listed: d.jpg\nexhaustive_matcher"));
  for (int i = 0; i < 20; ++i) write_photo(photos / ("zoom" + std::to_string(i) + ".jpg"), picture(96, 64), 1, 30 + i);
  CHECK(holds(bench.process({"--overwrite"}).err, "24 photos, 23 cameras"));
  CHECK(holds(bench.calls(), "--ImageReader.single_camera 0"));
  CHECK_FALSE(holds(bench.calls(), "listed"));
}

TEST_CASE("hidden files and folders, and what process itself made, are no photos") {
  const Bench bench("phone-hidden");
  const fs::path photos = bench.root / "photos";
  for (const char* name : {"a.jpg", "b.jpg", "c.jpg"}) write_photo(photos / name, picture(96, 64), 1);
  CHECK(holds(bench.process().err, "3 photos, one camera"));
  CHECK_FALSE(holds(bench.calls(), "listed"));
  for (const char* folder : {".thumbnails", "colmap/upright", "images"}) {
    fs::create_directories(photos / folder);
    write_photo(photos / folder / "d.jpg", picture(96, 64), 1);
  }
  write_text(photos / "._a.jpg", "AppleDouble");
  write_text(photos / "colmap/source.json", "{}");
  CHECK(holds(bench.process({"--overwrite"}).err, "4 photos, one camera"));  // images/ may be anybody's
  CHECK(holds(bench.calls(), "listed: a.jpg\nlisted: b.jpg\nlisted: c.jpg\nlisted: images/d.jpg\n"));
  fs::create_directory_symlink(photos / "images", bench.root / "data/images");
  CHECK(holds(bench.process({"--overwrite"}).err, "3 photos, one camera"));  // now it is that of the capture
}

TEST_CASE("HEIC photos are read") {
  if (!fs::exists("/usr/bin/heif-enc")) {
    MESSAGE("skipped: no heif-enc");
    return;
  }
  const Bench bench("phone-heic");
  const Image truth = picture(96, 64);
  for (const char* name : {"a", "b", "c"}) {
    const fs::path plain = bench.root / "plain.png", photo = bench.root / "photos" / (std::string(name) + ".HEIC");
    write_png(plain, truth);
    REQUIRE(
        std::system(("heif-enc -q 95 " + quoted(plain.string()) + " -o " + quoted(photo.string()) + " > /dev/null 2>&1")
                        .c_str()) == 0);
  }
  const Outcome made = bench.process();
  CHECK_MESSAGE(holds(made.err, "3 photos, one camera"), made.err);
  CHECK(psnr(read_image(bench.upright() / "b.HEIC.jpg"), truth) > 30);
  write_text(bench.root / "photos/b.HEIC", "no photo");
  const Outcome damaged = bench.process({"--overwrite"});
  CHECK(damaged.code == 3);
  CHECK(holds(damaged.err, "b.HEIC: damaged photo"));
}

TEST_CASE("photos that lie on their side become an upright capture with COLMAP itself") {
  const char* given = std::getenv("CLOAM_TEST_DATA");
  const fs::path photos = fs::path(given ? given : "../shared/data") / "fox/images";
  if (!fs::exists("/usr/bin/colmap") || !fs::exists(photos)) {
    MESSAGE("skipped: no colmap, or no data");
    return;
  }
  const fs::path root = scratch() / "phone-fox";
  fs::create_directories(root / "photos");
  std::vector<fs::path> names;
  for (const auto& entry : fs::directory_iterator(photos)) names.push_back(entry.path());
  std::sort(names.begin(), names.end());
  for (std::size_t i = 0; i < 8; ++i) {
    const Image image = downscale(read_image(names[i]), 4);
    const int orientation = i % 2 == 0 ? 6 : 8;  // the phone's left or right side is down
    write_photo(root / "photos" / (std::to_string(i) + ".jpg"), stored_as(image, orientation), orientation);
  }
  const Outcome made = cloam_with({"process", (root / "photos").string(), "-o", (root / "data").string(), "--json"});
  CHECK_MESSAGE(made.code == 0, made.err);
  CHECK(nlohmann::json::parse(made.out)["images"] >= 6);
  const Scene scene = read_scene(root / "data");
  REQUIRE(scene.cameras.size() == 1);
  CHECK(scene.cameras[0].height > scene.cameras[0].width);
  for (const Frame& frame : scene.frames)  // as they were held, they agree on what is down
    CHECK(frame.world_from_camera.col(1).dot(scene.frames[0].world_from_camera.col(1)) > 0.8);
}
