// Photos that are not 8 bits of sRGB: 16-bit PNG, linear EXR, several exposures. Written by Python with nothing but its
// own library, which also says what sRGB's formula makes of the light.
#include <doctest/doctest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/data/write_transforms.h"
#include "models/io/json.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

// Light from 0.001 to 1.2, and what 8 bits of sRGB hold of it at an exposure of 1.
const char* const kProgram = R"py(
import json, math, struct, zlib

width, height = 32, 4
light = [[[0.001 * 1200 ** ((x + width * y) / (width * height - 1)) * share for share in (1, 0.5, 0.25)] for x in range(width)] for y in range(height)]

def srgb(v):
    v = min(max(v, 0), 1)
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055

def png(path, rows, bits):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    lines = b"".join(b"\0" + b"".join(struct.pack(">H" if bits == 16 else ">B", round(min(v, 1) * (2 ** bits - 1))) for p in row for v in p) for row in rows)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))

def exr(path, rows):
    def attribute(name, kind, value):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(name + b"\0" + struct.pack("<iB3x2i", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    header = struct.pack("<2i", 20000630, 2) + attribute(b"channels", b"chlist", channels)
    header += attribute(b"compression", b"compression", b"\0")
    header += attribute(b"dataWindow", b"box2i", window) + attribute(b"displayWindow", b"box2i", window)
    header += attribute(b"lineOrder", b"lineOrder", b"\0") + attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    header += attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0))
    header += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
    size, begin = 8 + 12 * width, len(header) + 8 * height
    with open(path, "wb") as file:
        file.write(header + b"".join(struct.pack("<Q", begin + size * y) for y in range(height)))
        for y, row in enumerate(rows):
            file.write(struct.pack("<2i", y, 12 * width) + b"".join(struct.pack("<%df" % width, *[p[c] for p in row]) for c in (2, 1, 0)))

def times(factor, of=light, f=lambda v: v):
    return [[[f(factor * v) for v in p] for p in row] for row in of]

exr("one.exr", light)
exr("quarter.exr", times(0.25))
png("deep.png", times(1, light, srgb), 16)
png("linear.png", light, 16)
png("dark.png", times(0.25, light, srgb), 16)
with open("truth.json", "w") as file:
    json.dump([round(255 * srgb(v)) for row in light for p in row for v in p], file)
)py";

struct Photos {
  Folder folder;
  bool made = false;

  Photos() {
    write_text(folder.path / "write.py", kProgram);
    made = std::system(("cd '" + folder.path.string() + "' && /usr/bin/python3 write.py").c_str()) == 0;
  }
  /// The capture of photos with these keys each.
  Scene scene(const std::vector<std::pair<std::string, std::string>>& photos, const std::string& keys = "") const {
    std::string frames;
    for (const auto& [file, own] : photos)
      frames += (frames.empty() ? "" : ",") + (R"({"file_path":")" + file) +
                R"(","transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0]])" + own + "}";
    write_text(folder.path / "transforms.json", R"({"fl_x":30,"w":32,"h":4)" + keys + R"(,"frames":[)" + frames + "]}");
    return read_scene(folder.path);
  }
  /// How many levels of 255 a photo is off at the most, and how many channels are.
  std::pair<int, int> off(const Pixels& pixels, std::size_t photo) const {
    const Json truth = parse_json_file(folder.path / "truth.json");
    const std::vector<std::uint8_t>& rgba = pixels.frames.at(photo).rgba;
    std::pair<int, int> found;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const int by = std::abs(truth[i].get<int>() - rgba.at(4 * (i / 3) + i % 3));
      found = {std::max(found.first, by), found.second + (by > 0)};
    }
    return found;
  }
};

constexpr std::pair<int, int> kNothing{0, 0};

}  // namespace

TEST_CASE("linear EXR and 16-bit PNG become sRGB from all of their bits") {
  const Photos photos;
  if (!photos.made) {
    MESSAGE("skipped: no python3");
    return;
  }
  const Pixels pixels =
      load_images(photos.scene({{"one.exr", ""}, {"deep.png", ""}, {"linear.png", R"(,"linear":true)"}}), Split::train);
  CHECK(photos.off(pixels, 0) == kNothing);
  CHECK(photos.off(pixels, 1) == kNothing);
  CHECK(photos.off(pixels, 2).first <= 1);  // the darkest light has few of its 16 bits
  CHECK(photos.off(pixels, 2).second <= 4);
  const Pixels as_stored = load_images(photos.scene({{"one.exr", ""}}, R"(,"linear":false)"), Split::train);
  CHECK(photos.off(as_stored, 0).first > 60);
}

TEST_CASE("photos of several exposures show the same light as the same colours") {
  const Photos photos;
  if (!photos.made) {
    MESSAGE("skipped: no python3");
    return;
  }
  const Scene scene = photos.scene({{"one.exr", R"(,"exposure":0.02)"},
                                    {"quarter.exr", R"(,"exposure":0.005)"},
                                    {"dark.png", R"(,"exposure":0.005)"},
                                    {"deep.png", R"(,"exposure":0.02)"},
                                    {"linear.png", ""}},
                                   R"(,"exposure":0.02)");
  const Pixels pixels = load_images(scene, Split::train);
  for (std::size_t i = 0; i < 4; ++i) {
    const auto [levels, channels] = photos.off(pixels, i);
    CAPTURE(i);
    CHECK(levels <= 1);  // where the truth lies between two levels, and 16 bits say one of them
    CHECK(channels <= 4);
  }
  CHECK(scene.frames[1].exposure == 0.25);
  write_transforms(photos.folder.path / "again", scene);
  const Pixels again = load_images(read_scene(photos.folder.path / "again"), Split::train);
  for (std::size_t i = 0; i < 5; ++i) CHECK(again.frames[i].rgba == pixels.frames[i].rgba);
  CHECK(holds(error_of([&] { photos.scene({{"one.exr", R"(,"exposure":0)"}}); }), "exposure is 0, want more than 0"));
  CHECK(holds(error_of([&] { photos.scene({{"one.exr", R"(,"linear":1)"}}); }), "linear is number"));
}
