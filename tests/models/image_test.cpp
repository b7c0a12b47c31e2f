// Images: round trips, the box filter against arithmetic by hand, and files that lie about themselves.
#include "models/io/image.h"

#include <OpenImageIO/imageio.h>
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

#include "models/io/bytes.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const fs::path& path) { return read_file(path, 1 << 30); }

void put(const fs::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::ssize(bytes));
}

Image noise(int width, int height, int channels) {
  Image image{width, height, channels, Bytes(std::size_t(width) * height * channels)};
  std::uint32_t state = 7;
  for (auto& value : image.pixels) value = static_cast<std::uint8_t>((state = state * 1664525u + 1013904223u) >> 24);
  return image;
}

Bytes tga(int width, int height) {
  Bytes bytes(18 + std::size_t(width) * height * 3, 100);
  std::fill_n(bytes.begin(), 18, std::uint8_t{0});
  bytes[2] = 2;
  bytes[12] = static_cast<std::uint8_t>(width);
  bytes[14] = static_cast<std::uint8_t>(height);
  bytes[16] = 24;
  return bytes;
}

}  // namespace

TEST_CASE("a glance at an image tells its size, and that its end is missing") {
  const Folder folder;
  write_jpeg(folder.path / "a.jpg", noise(300, 200, 3));  // 100 KB: more than is looked at
  write_png(folder.path / "a.png", noise(300, 200, 3));
  for (const char* name : {"a.jpg", "a.png"}) {
    CAPTURE(name);
    const fs::path path = folder.path / name;
    REQUIRE(fs::file_size(path) > 80000);
    const ImageSize size = peek_image_size(path);
    CHECK(size.width == 300);
    CHECK(size.height == 200);
    CHECK(size.channels == 3);
    fs::resize_file(path, fs::file_size(path) - 1);
    CHECK(error_of([&] { peek_image_size(path); }) == error_of([&] { read_image(path); }));
    CHECK_FALSE(error_of([&] { peek_image_size(path); }).empty());
  }
}

TEST_CASE("a PNG comes back as it was written, alpha straight") {
  const Folder folder;
  for (int channels = 1; channels <= 4; ++channels) {
    const Image image = noise(13, 7, channels);
    write_png(folder.path / "a.png", image);
    const Image back = read_image(folder.path / "a.png");
    CHECK(back.width == 13);
    CHECK(back.height == 7);
    CHECK(back.channels == channels);
    CHECK(back.pixels == image.pixels);
    CHECK(read_image_size(folder.path / "a.png").channels == channels);
    CHECK(peek_image_size(folder.path / "a.png").channels == channels);
  }
  CHECK(std::distance(fs::directory_iterator(folder.path), {}) == 1);
}

TEST_CASE("writing the same image twice gives the same bytes") {
  const Folder folder;
  write_png(folder.path / "a.png", noise(20, 20, 3));
  write_png(folder.path / "b.png", noise(20, 20, 3));
  CHECK(bytes_of(folder.path / "a.png") == bytes_of(folder.path / "b.png"));
}

TEST_CASE("an EXR keeps its named layers exactly") {
  const Folder folder;
  const std::vector<float> red = {0.5f, 0.1f, 2, 0, -1, 1e-8f}, depth = {1, 2, 3, 4, 1e20f, 6}, alpha(6, 1.0f);
  const fs::path path = folder.path / "a.exr";
  write_exr(path, 3, 2, {{"R", red.data()}, {"A", alpha.data()}, {"depth.Z", depth.data()}});
  CHECK(read_exr_layer(path, "R") == red);
  CHECK(read_exr_layer(path, "depth.Z") == depth);
  CHECK(holds(error_of([&] { read_exr_layer(path, "normal.X"); }), "depth.Z"));
}

TEST_CASE("an EXR read as an image is clamped, rounded and divided by its alpha") {
  const Folder folder;
  const std::vector<float> red = {0.25f, 2}, green = {0, 0.5f}, blue = {0.5f, -1}, alpha = {0.5f, 1};
  write_exr(folder.path / "a.exr", 2, 1,
            {{"R", red.data()}, {"G", green.data()}, {"B", blue.data()}, {"A", alpha.data()}});
  const Image image = read_image(folder.path / "a.exr");
  CHECK(image.pixels == Bytes{128, 0, 255, 128, 255, 128, 0, 255});
  const std::vector<float> bad = {std::numeric_limits<float>::quiet_NaN(), 0};
  write_exr(folder.path / "b.exr", 2, 1, {{"Y", bad.data()}});
  CHECK(holds(error_of([&] { read_image(folder.path / "b.exr"); }), "pixel 0, 0 is not finite"));
}

TEST_CASE("downscale is the rounded mean of boxes, colours weighted by alpha") {
  const Image grey{5, 2, 1, {0, 1, 10, 20, 99, 2, 4, 30, 41, 99}};
  const Image half = downscale(grey, 2);
  CHECK(half.width == 2);
  CHECK(half.height == 1);
  CHECK(half.pixels == Bytes{2, 25});  // 7/4 and 101/4
  const Image clear{2, 2, 4, {200, 0, 0, 255, 0, 90, 9, 0, 100, 0, 0, 255, 255, 255, 255, 0}};
  CHECK(downscale(clear, 2).pixels == Bytes{150, 0, 0, 128});  // the clear pixels' colours do not count
  CHECK_THROWS_AS(downscale(grey, 3), Error);
  CHECK(downscale(grey, 1).pixels == grey.pixels);
}

TEST_CASE("a PNG that is a TGA, and other names that lie, are refused by content") {
  const Folder folder;
  put(folder.path / "a.png", tga(4, 4));
  CHECK(holds(error_of([&] { read_image(folder.path / "a.png"); }), "TGA"));
  write_png(folder.path / "b.png", noise(4, 4, 3));
  fs::rename(folder.path / "b.png", folder.path / "b.jpg");
  CHECK(holds(error_of([&] { read_image(folder.path / "b.jpg"); }), "content is png"));
  fs::rename(folder.path / "b.jpg", folder.path / "b");
  CHECK(read_image(folder.path / "b").width == 4);  // no extension claims nothing
  put(folder.path / "c.png", {});
  CHECK(holds(error_of([&] { read_image(folder.path / "c.png"); }),
              "the file is empty; copy it again, or use --skip-bad"));
  const auto holding = [&](const std::string& content) {
    put(folder.path / "c.png", {content.begin(), content.end()});
    return error_of([&] { read_image(folder.path / "c.png"); });
  };
  CHECK(holds(holding(std::string(500, '\0')), "the file holds nothing but zeros; copy it again, or use --skip-bad"));
  CHECK(holds(holding("version https://git-lfs.github.com/spec/v1\noid"), "it is a pointer of Git LFS: git lfs pull"));
  CHECK(holds(holding("<!DOCTYPE html>\n<html>"), "it is a web page"));
  CHECK(holds(holding("a letter"), "found something else; copy it again, or use --skip-bad"));
  CHECK(holds(error_of([&] { read_image(folder.path / "none.png"); }), "no such file"));
  CHECK(holds(error_of([&] { read_image(folder.path); }), "folder"));
}

TEST_CASE("a PNG cut short anywhere is an error") {
  const Folder folder;
  write_png(folder.path / "a.png", noise(9, 9, 4));
  const Bytes all = bytes_of(folder.path / "a.png");
  for (std::size_t length = 0; length < all.size(); ++length) {
    put(folder.path / "cut.png", Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(length)));
    CHECK_MESSAGE(error_of([&] { read_image(folder.path / "cut.png"); }) != "no error", length);
  }
}

TEST_CASE("an EXR cut short anywhere is an error") {
  const Folder folder;
  const std::vector<float> values(64, 0.5f);
  write_exr(folder.path / "a.exr", 8, 8, {{"Y", values.data()}});
  const Bytes all = bytes_of(folder.path / "a.exr");
  for (std::size_t length = 0; length < all.size(); length += 3) {
    put(folder.path / "cut.exr", Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(length)));
    CHECK_MESSAGE(error_of([&] { read_image(folder.path / "cut.exr"); }) != "no error", length);
  }
}

TEST_CASE("a PNG with a flipped bit is an error") {
  const Folder folder;
  write_png(folder.path / "a.png", noise(9, 9, 4));
  Bytes all = bytes_of(folder.path / "a.png");
  all[all.size() / 2] ^= 4;
  put(folder.path / "a.png", all);
  CHECK(error_of([&] { read_image(folder.path / "a.png"); }) != "no error");
}

TEST_CASE("a header that claims more than the limit is refused before anything is allocated") {
  const Folder folder;
  write_png(folder.path / "a.png", noise(9, 9, 4));
  Bytes all = bytes_of(folder.path / "a.png");
  all[17] = all[21] = 1;  // 65545 x 65545; the CRC of the header no longer fits either
  put(folder.path / "a.png", all);
  CHECK(error_of([&] { read_image(folder.path / "a.png"); }) != "no error");
}

TEST_CASE("an EXR whose header claims a huge picture is refused by its size") {
  const Folder folder;
  const std::vector<float> values(64, 0.5f);
  write_exr(folder.path / "a.exr", 8, 8, {{"Y", values.data()}});
  Bytes all = bytes_of(folder.path / "a.exr");
  const Bytes window = {0, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 7, 0, 0, 0};
  for (auto at = all.begin(); (at = std::search(at, all.end(), window.begin(), window.end())) != all.end(); ++at) {
    at[11] = 1;  // the right edge: 2^24 + 7
  }
  put(folder.path / "a.exr", all);
  const std::string message = error_of([&] { read_image(folder.path / "a.exr"); });
  CHECK_MESSAGE(holds(message, "16777224x8"), message);
}

TEST_CASE("EXR pixels come back the same from lines, tiles and several channels") {
  const Folder folder;
  constexpr int w = 70, h = 45;
  std::vector<float> planes[4];
  for (int c = 0; c < 4; ++c)
    for (int i = 0; i < w * h; ++i) planes[c].push_back(c == 3 ? 1.f : float((i * (c + 3)) % 256) / 255);
  std::vector<Layer> layers;
  for (int c = 0; c < 4; ++c) layers.push_back({std::string(1, "RGBA"[c]), planes[c].data()});
  write_exr(folder.path / "a.exr", w, h, layers);
  OIIO::ImageSpec spec(w, h, 4, OIIO::TypeDesc::FLOAT);
  spec.tile_width = spec.tile_height = 16;
  std::vector<float> mixed;
  for (int i = 0; i < w * h; ++i)
    for (const auto& plane : planes) mixed.push_back(plane[std::size_t(i)]);
  const auto output = OIIO::ImageOutput::create("openexr");
  REQUIRE(output->open((folder.path / "tiles.exr").string(), spec));
  REQUIRE(output->write_image(OIIO::TypeDesc::FLOAT, mixed.data()));
  output->close();
  const Image lines = read_image(folder.path / "a.exr"), tiles = read_image(folder.path / "tiles.exr");
  for (int i = 0; i < w * h; ++i) CHECK(lines.pixels[std::size_t(4 * i + 1)] == (i * 4) % 256);
  CHECK(lines.pixels == tiles.pixels);
  CHECK(read_exr_layer(folder.path / "tiles.exr", "G") == planes[1]);
}

TEST_CASE("an EXR that a few bytes promise is refused before it is decoded") {
  const Folder folder;
  OIIO::ImageSpec spec(64, 64, 3, OIIO::TypeDesc::FLOAT);
  spec.tile_width = spec.tile_height = 32;
  const std::vector<float> values(64 * 64 * 3, 0.5f);
  const auto output = OIIO::ImageOutput::create("openexr");
  REQUIRE(output->open((folder.path / "a.exr").string(), spec));
  REQUIRE(output->write_image(OIIO::TypeDesc::FLOAT, values.data()));
  output->close();
  const Bytes sound = bytes_of(folder.path / "a.exr");
  const auto with = [&](std::int32_t width, std::int32_t height, std::int32_t tile_width, std::int32_t tile_height) {
    Bytes all = sound;
    const auto change = [&](std::vector<std::int32_t> from, std::vector<std::int32_t> to) {
      const auto* old = reinterpret_cast<const std::uint8_t*>(from.data());
      const auto* now = reinterpret_cast<const std::uint8_t*>(to.data());
      for (auto at = all.begin(); (at = std::search(at, all.end(), old, old + 4 * from.size())) != all.end(); ++at)
        std::copy(now, now + 4 * to.size(), at);
    };
    change({0, 0, 63, 63}, {0, 0, width - 1, height - 1});
    change({32, 32}, {tile_width, tile_height});
    put(folder.path / "b.exr", all);
    return error_of([&] { read_image(folder.path / "b.exr"); });
  };
  CHECK(with(64, 64, 32, 32) == "no error");
  CHECK(holds(with(8192, 5461, 8192, 5461), "but the file has only"));     // one tile, half a gigabyte
  CHECK(holds(with(100000, 100000, 1, 1), "declares 10000000000 parts"));  // a table of 80 GB
  CHECK(holds(with(64, 64, 8192, 4096), "blocks of 8192x4096 pixels"));
  put(folder.path / "b.exr", sound);
}

TEST_CASE("a large EXR takes little more memory than its bytes") {
  const Folder folder;
  constexpr int side = 2048;
  {
    std::vector<float> values(std::size_t(side) * side);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = float(i % 251) / 251;
    write_exr(folder.path / "a.exr", side, side,
              {{"R", values.data()}, {"G", values.data()}, {"B", values.data()}, {"A", values.data()}});
  }
  const auto kilobytes = [](const std::string& key) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
      if (line.starts_with(key)) return std::stol(line.substr(key.size() + 1));
    return 0L;
  };
  read_image_size(folder.path / "a.exr");  // the library's own beginnings
  std::ofstream("/proc/self/clear_refs") << 5;
  const long before = kilobytes("VmRSS");
  CHECK(read_image(folder.path / "a.exr").pixels.size() == std::size_t(4) * side * side);
  const long most = kilobytes("VmHWM");
  CHECK(most - before < 48 * 1024);  // 16 MB of bytes; as floats alone they would be 64 MB
}

TEST_CASE("an EXR of many layers is read as its colours, by name; one without is refused with what it has") {
  const Folder folder;
  const std::vector<float> red = {1}, green = {0.5f}, blue = {0.25f}, alpha = {1}, other = {0};
  const auto pixel = [&](const std::vector<Layer>& layers) {
    write_exr(folder.path / "a.exr", 1, 1, layers);
    const Image image = read_image(folder.path / "a.exr");
    CHECK(read_image_size(folder.path / "a.exr").channels == image.channels);
    return image.pixels;
  };
  const Layer r{"R", red.data()}, g{"G", green.data()}, b{"B", blue.data()}, a{"A", alpha.data()},
      z{"depth.Z", other.data()}, x{"N.X", other.data()}, plain{"Z", other.data()};
  CHECK(pixel({r, g, b, a, z, x}) == Bytes{255, 128, 64, 255});
  CHECK(pixel({b, plain, r, g}) == Bytes{255, 128, 64});
  CHECK(pixel({plain, {"Y", green.data()}}) == Bytes{128});
  CHECK(pixel({{"V", green.data()}}) == Bytes{128});
  CHECK(pixel({{"red", red.data()}, {"green", green.data()}, {"blue", blue.data()}}) == Bytes{255, 128, 64});
  const auto layer = [&](const std::string& name) {
    return std::vector<Layer>{{name + ".R", red.data()}, {name + ".G", green.data()}, {name + ".B", blue.data()}};
  };
  CHECK(pixel(layer("beauty")) == Bytes{255, 128, 64});
  std::vector<Layer> blender = layer("ViewLayer.Combined");
  blender.insert(blender.end(), {{"ViewLayer.Combined.A", alpha.data()}, {"ViewLayer.Depth.Z", other.data()}});
  for (const char* c : {"R", "G", "B"}) blender.push_back({std::string("ViewLayer.Albedo.") + c, other.data()});
  CHECK(pixel(blender) == Bytes{255, 128, 64, 255});
  std::vector<Layer> two = layer("left");
  for (const Layer& one : layer("right")) two.push_back(one);
  CHECK(holds(error_of([&] { pixel(two); }),
              "looked for channels R, G, B (and A) or Y, of one layer at most, found left."));
  CHECK(holds(error_of([&] { pixel({plain}); }), "of one layer at most, found Z; save"));
  write_png(folder.path / "rgb.png", noise(4, 4, 3));
  CHECK(holds(error_of([&] { read_labels(folder.path / "rgb.png"); }), "rgb.png: has 3 channels, want 1"));
}

TEST_CASE("an EXR that shows a part of its picture is refused") {
  const Folder folder;
  OIIO::ImageSpec spec(8, 8, 3, OIIO::TypeDesc::FLOAT);
  spec.full_width = 16;
  const std::vector<float> values(8 * 8 * 3, 0.5f);
  const auto output = OIIO::ImageOutput::create("openexr");
  REQUIRE(output->open((folder.path / "a.exr").string(), spec));
  REQUIRE(output->write_image(OIIO::TypeDesc::FLOAT, values.data()));
  output->close();
  CHECK(holds(error_of([&] { read_image(folder.path / "a.exr"); }), "data window (8x8 at 0, 0)"));
}

TEST_CASE("a PNG of nothing but zeros that would fill the memory is refused; a large mask is not") {
  const Folder folder;
  write_png(folder.path / "mask.png", {8192, 4096, 1, Bytes(std::size_t(8192) * 4096)});
  CHECK(read_image(folder.path / "mask.png").width == 8192);
  write_png(folder.path / "bomb.png", {16384, 8192, 1, Bytes(std::size_t(16384) * 8192)});
  CHECK(holds(error_of([&] { read_image_size(folder.path / "bomb.png"); }), "but the file has only"));
}

TEST_CASE("a real JPEG reads, and cut in the middle it is an error") {
  const fs::path photo = test_data("fox/images/0001.jpg");
  if (no_data(photo)) return;
  const Image image = read_image(photo);
  CHECK(image.width == 1080);
  CHECK(image.height == 1920);
  CHECK(image.channels == 3);
  const Folder folder;
  const Bytes all = bytes_of(photo);
  for (const double part : {0.001, 0.01, 0.1, 0.5, 0.9, 0.9999}) {
    put(folder.path / "cut.jpg", Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(part * all.size())));
    CHECK_MESSAGE(error_of([&] { read_image(folder.path / "cut.jpg"); }) != "no error", part);
  }
  Bytes closed(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2));
  closed.insert(closed.end(), {0xff, 0xd9});  // half the picture with an end mark
  put(folder.path / "cut.jpg", closed);
  CHECK(error_of([&] { read_image(folder.path / "cut.jpg"); }) != "no error");
}

TEST_CASE("the byte reader refuses to pass the end") {
  const Bytes bytes = {1, 2, 3, 4, 'a', 'b', 0, 9};
  ByteReader reader(bytes, "x.bin");
  CHECK(reader.little<std::uint16_t>("n") == 0x0201);
  CHECK(reader.big(2, "n") == 0x0304);
  CHECK(reader.zero_ended(10, "s") == "ab");
  CHECK(holds(error_of([&] { reader.little<float>("a weight"); }), "x.bin: ends in the middle of a weight"));
  CHECK(holds(error_of([&] { reader.skip(~0ull, "a block"); }), "at byte 7"));
  CHECK(holds(error_of([&] { reader.zero_ended(10, "s"); }), "no end"));
}
