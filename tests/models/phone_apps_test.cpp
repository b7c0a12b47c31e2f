// Exports of Polycam and Record3D, written here as those apps do; where the cameras are is told by hand.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cstdlib>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

void write_image(const fs::path& path, int width, int height) {
  fs::create_directories(path.parent_path());
  write_jpeg(path, {width, height, 3, std::vector<std::uint8_t>(std::size_t(width * height * 3), 90)});
}

/// A quarter turn to the left about y, which is up: the camera looks along -x.
const char* const kPolycamCamera = R"({"fx":10,"fy":11,"cx":4.5,"cy":2.5,"width":8,"height":6,"blur_score":90.5,
  "timestamp":7, "t_00":0,"t_01":0,"t_02":1,"t_03":2, "t_10":0,"t_11":1,"t_12":0,"t_13":3, "t_20":-1,"t_21":0,"t_22":0,
  "t_23":4})";

void check_quarter_turn(const Frame& frame) {
  CHECK((frame.world_from_camera * Eigen::Vector4d(0, 0, 1, 0)).isApprox(Eigen::Vector4d(-1, 0, 0, 0), 1e-6));
  CHECK((frame.world_from_camera * Eigen::Vector4d(0, -1, 0, 0)).isApprox(Eigen::Vector4d(0, 1, 0, 0), 1e-6));
  CHECK((frame.world_from_camera * Eigen::Vector4d(1, 0, 0, 0)).isApprox(Eigen::Vector4d(0, 0, -1, 0), 1e-6));
  CHECK(frame.position().isApprox(Eigen::Vector3d(2, 3, 4)));
}

}  // namespace

TEST_CASE("Polycam: cameras by name, in metres with y up; corrected ones first") {
  const Folder folder;
  const fs::path keyframes = folder.path / "keyframes";
  write_text(keyframes / "cameras/71.json", kPolycamCamera);
  write_text(keyframes / "cameras/72.json", kPolycamCamera);
  write_image(keyframes / "images/71.jpg", 8, 6);
  const Scene scene = read_scene(folder.path);
  CHECK(scene.format == "Polycam");
  CHECK(scene.metric);
  CHECK(scene.up == Eigen::Vector3d(0, 1, 0));
  REQUIRE(scene.frames.size() == 1);
  CHECK(scene.frames_listed == 2);
  CHECK(scene.frames[0].image == "keyframes/images/71.jpg");
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 10, 11, 4.5, 2.5}});
  check_quarter_turn(scene.frames[0]);
  CHECK_FALSE(scene.frames[0].depth);
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "1 of 2 listed images are missing and skipped: keyframes/images/72.jpg"));

  write_text(keyframes / "corrected_cameras/71.json", kPolycamCamera);
  write_image(keyframes / "corrected_images/71.jpg", 8, 6);
  CHECK(read_scene(folder.path).frames.at(0).image == "keyframes/corrected_images/71.jpg");
  write_text(keyframes / "corrected_cameras/71.json",
             R"({"fx":10,"fy":11,"cx":4,"cy":3,"width":8,"height":6,"t_00":1})");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "keyframes/corrected_cameras/71.json"));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "t_01"));
}

TEST_CASE("Record3D: quaternions with the real part last, K by columns, intrinsics of each photo") {
  const Folder folder;
  const fs::path root = folder.path / "EXR_RGBD";
  const std::string poses = R"("poses":[[0,0.70710678,0,0.70710678,2,3,4],[0,0,0,1,0,0,0],[0,0,0,1,9,0,0]])";
  const std::string all = R"({"w":8,"h":6,"fps":30,"K":[10,0,0,0,11,0,4.2,3.1,1],)" + poses;
  write_text(root / "metadata.json", all + "}");
  for (const char* name : {"0", "1", "2"}) write_image(root / "rgb" / (std::string(name) + ".jpg"), 8, 6);
  Scene scene = read_scene(folder.path);
  CHECK(scene.format == "Record3D");
  CHECK(scene.metric);
  REQUIRE(scene.frames.size() == 3);
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 10, 11, 4.2, 3.1}});
  check_quarter_turn(scene.frames[0]);
  CHECK(scene.frames[2].position() == Eigen::Vector3d(9, 0, 0));
  CHECK(scene.up.isApprox(Eigen::Vector3d(0, 1, 0), 1e-6));
  CHECK(read_scene(root).frames.size() == 3);  // the folder itself, too

  write_text(root / "metadata.json", all + R"(,"perFrameIntrinsicCoeffs":[[12,13,4,3],[10,11,4.2,3.1],[10,11,1,3]]})");
  scene = read_scene(folder.path);
  CHECK(scene.cameras == std::vector<Camera>{{8, 6, 12, 13, 4, 3}, {8, 6, 10, 11, 4.2, 3.1}, {8, 6, 10, 11, 4, 3}});

  CHECK(scene.warnings.empty());

  write_text(root / "metadata.json", all + R"(,"perFrameIntrinsicCoeffs":[[12,13,4,3]]})");
  write_image(root / "rgb/3.jpg", 8, 6);
  scene = read_scene(folder.path);
  CHECK(scene.frames.size() == 3);
  REQUIRE(scene.warnings.size() == 2);
  CHECK(holds(scene.warnings[0], "metadata.json has 3 poses, EXR_RGBD/rgb/ has 4 photos"));
  CHECK(holds(scene.warnings[1], "has 3 poses and perFrameIntrinsicCoeffs of 1 photos"));
  fs::remove(root / "rgb/3.jpg");

  write_text(root / "metadata.json", R"({"w":8,"h":6,"K":[10,0,0,0,11,0,4,3],)" + poses + "}");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "EXR_RGBD/metadata.json, K: want 9 finite numbers"));
  write_text(root / "metadata.json", R"({"w":8,"h":6,"K":[10,0,0,0,11,0,4,3,1],"poses":[[0,0,0,2,0,0,0]]})");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "pose 0: the quaternion has the length 2"));
}

// Written by Python with nothing but its own library: PNG chunks, and an EXR of one uncompressed float channel as
// Record3D's.
TEST_CASE("Polycam and Record3D: depth maps in metres, without what the phone only guessed") {
  if (std::system("/usr/bin/python3 -c 'import zlib' >/dev/null 2>&1") != 0) {
    MESSAGE("skipped: no python3");
    return;
  }
  const Folder folder;
  write_text(folder.path / "write.py", R"py(
import os, struct, zlib

def png(path, rows, bits):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    lines = b"".join(b"\0" + struct.pack(">%d%s" % (len(row), "H" if bits == 16 else "B"), *row) for row in rows)
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), bits, 0, 0, 0, 0)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))

def exr(path, rows):
    width, height = len(rows[0]), len(rows)
    def attribute(name, kind, value):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = struct.pack("<2i", 20000630, 2)
    header += attribute(b"channels", b"chlist", b"R\0" + struct.pack("<iB3x2i", 2, 0, 1, 1) + b"\0")
    header += attribute(b"compression", b"compression", b"\0")
    header += attribute(b"dataWindow", b"box2i", window) + attribute(b"displayWindow", b"box2i", window)
    header += attribute(b"lineOrder", b"lineOrder", b"\0") + attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    header += attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0))
    header += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
    size, begin = 8 + 4 * width, len(header) + 8 * height
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(header + b"".join(struct.pack("<Q", begin + size * y) for y in range(height)))
        for y, row in enumerate(rows):
            file.write(struct.pack("<2i%df" % width, y, 4 * width, *row))

png("polycam/keyframes/depth/71.png", [[1000, 2000, 3000, 0], [1500, 65535, 7, 800], [1, 2, 3, 4]], 16)
png("polycam/keyframes/confidence/71.png", [[255, 54, 53, 255], [0, 255, 254, 255], [255] * 4], 8)
exr("record3d/EXR_RGBD/depth/0.exr", [[1, 2, 3, float("nan")], [1.5, 0, 0.25, 0.8], [1, 2, 3, 4]])
)py");
  REQUIRE(std::system(("cd '" + folder.path.string() + "' && /usr/bin/python3 write.py").c_str()) == 0);
  const fs::path polycam = folder.path / "polycam", record3d = folder.path / "record3d";
  write_text(polycam / "keyframes/cameras/71.json", kPolycamCamera);
  write_image(polycam / "keyframes/images/71.jpg", 8, 6);
  write_text(record3d / "EXR_RGBD/metadata.json",
             R"({"w":8,"h":6,"K":[10,0,0,0,11,0,4,3,1],"poses":[[0,0,0,1,0,0,0]]})");
  write_image(record3d / "EXR_RGBD/rgb/0.jpg", 8, 6);
  const auto depths = [](const fs::path& root) {
    const Scene scene = read_scene(root);
    CHECK(scene.warnings.empty());
    return load_images(scene, Split::train, {2, false, MaskMeaning::ignore, true}).frames.at(0).depth;
  };
  CHECK(depths(polycam) == std::vector<float>{1, 2, 0, 0, 0, 65.535f, 0.007f, 0.8f, 0.001f, 0.002f, 0.003f, 0.004f});
  CHECK(depths(record3d) == std::vector<float>{1, 2, 3, 0, 1.5f, 0, 0.25f, 0.8f, 1, 2, 3, 4});
  fs::remove(polycam / "keyframes/confidence/71.png");
  CHECK(depths(polycam)[2] == 3);
  write_text(polycam / "keyframes/confidence/71.png", "no image");
  CHECK(holds(error_of([&] { depths(polycam); }), "keyframes/confidence/71.png"));
  write_text(record3d / "EXR_RGBD/depth/0.exr", content_of(record3d / "EXR_RGBD/depth/0.exr").substr(0, 300));
  CHECK(holds(error_of([&] { depths(record3d); }), "EXR_RGBD/depth/0.exr"));
}
