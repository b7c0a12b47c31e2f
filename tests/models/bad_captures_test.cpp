// Readers of captures: folders that are none, and files that are damaged.
#include <doctest/doctest.h>
#include <unistd.h>

#include <filesystem>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/capture.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

TEST_CASE("folders that are almost a capture say what is wrong") {
  const Capture folder;
  const auto advice = [&](const std::string& name) { return error_of([&] { read_scene(folder.path / name); }); };
  const auto with = [&](const std::string& file) {
    fs::remove_all(folder.path / "data");
    fs::create_directories((folder.path / "data" / file).parent_path());
    folder.text_file("data/" + file, "");
    return advice("data");
  };
  CHECK(holds(with("sparse/0/cameras.bin"), "needs sparse/0/images.bin beside sparse/0/cameras.bin"));
  CHECK(holds(with("images.txt"), "needs cameras.txt beside images.txt"));
  CHECK(holds(with("Transforms.JSON"), "rename Transforms.JSON to transforms.json"));
  CHECK(holds(with("transforms.json.gz"), "unpack transforms.json.gz"));
  CHECK(holds(with("transforms_test.json"), "add transforms_train.json"));
  CHECK(holds(with("IMG_1.HEIC"), "cloam process " + (folder.path / "data").string() + " -o DATA"));
  CHECK(holds(with("images/IMG_1.heic"), "cloam process " + (folder.path / "data/images").string() + " -o DATA"));
  CHECK(holds(with("walk.MP4"), "cloam process " + (folder.path / "data/walk.MP4").string() + " -o DATA"));
  CHECK(holds(with("images/1.jpg"), "cloam process " + (folder.path / "data/images").string() + " -o DATA"));
  folder.image("my walk/1.png", 8, 6, {1, 2, 3});
  CHECK(holds(advice("my walk"), "cloam process '" + (folder.path / "my walk").string() + "' -o DATA"));
  folder.text_file("my walk/run.json", "");
  CHECK(holds(advice("my walk"), "cloam train --resume '" + (folder.path / "my walk").string() + "'"));
  for (const char* file : {"data.zip", "data.tar.gz"}) {
    folder.text_file(file, "");
    CHECK(holds(advice(file), "is an archive; unpack it"));
  }
  folder.text_file("walk.mov", "");
  CHECK(holds(advice("walk.mov"), "cloam process "));
  CHECK(holds(advice("gone"), "no such folder: " + (folder.path / "gone").string()));
  CHECK_FALSE(holds(advice("gone"), "looked for"));
}

TEST_CASE("a folder and files that may not be read: permission denied") {
  if (geteuid() != 0) {
    MESSAGE("skipped: only root can become somebody else");
    return;
  }
  const Capture folder;
  fs::permissions(folder.path, fs::perms::all);
  folder.image("open/a.png", 8, 6, {1, 2, 3});
  folder.text_file("open/transforms.json", capture(frame("a.png")));
  fs::copy(folder.path / "open", folder.path / "closed", fs::copy_options::recursive);
  fs::permissions(folder.path / "closed", fs::perms::owner_all);
  const auto as_nobody = [&](const char* name) {
    REQUIRE(seteuid(65534) == 0);
    const std::string message = error_of([&] { load_images(read_scene(folder.path / name), Split::train); });
    REQUIRE(seteuid(0) == 0);
    return message;
  };
  CHECK(holds(as_nobody("closed"), (folder.path / "closed").string() + ": permission denied"));
  fs::permissions(folder.path / "closed", fs::perms::owner_all | fs::perms::group_read | fs::perms::others_read);
  CHECK(holds(as_nobody("closed"), (folder.path / "closed").string() + ": permission denied"));
  fs::permissions(folder.path / "open/a.png", fs::perms::owner_all);
  CHECK(holds(as_nobody("open"), "a.png: permission denied"));
  fs::permissions(folder.path / "open/transforms.json", fs::perms::owner_all);
  CHECK(holds(as_nobody("open"), "transforms.json: permission denied"));
}

TEST_CASE("folders that are no data set say what was looked for, found, and what to do") {
  const Capture folder;
  const std::string empty = error_of([&] { read_scene(folder.path); });
  CHECK(holds(empty, "looked for: transforms.json"));
  CHECK(holds(empty, "the folder is empty"));
  folder.image("walk/images/a.png", 2, 2, {1, 2, 3});
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk"); }), "images/"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk/images"); }), "1 .png"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "wolk"); }), "did you mean " + (folder.path / "walk").string()));
  CHECK(holds(error_of([&] { read_scene(folder.path / "wolk/"); }), "did you mean"));
  folder.text_file("walk/transforms.json", capture(frame("images/a.png"), R"("fl_x":2)"));
  CHECK(holds(error_of([&] { read_scene(folder.path / "walk/transforms.json"); }), "give its folder"));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "give the folder inside it"));
  fs::create_directory_symlink(folder.path / "walk", folder.path / "link");
  CHECK(read_scene(folder.path / "link").frames.size() == 1);
}

TEST_CASE("bad frames stop with the frame and key named, or are dropped with skip_bad") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.image("b.png", 8, 6, {1, 2, 3});
  const auto attempt = [&](const std::string& bad) {
    folder.text_file("transforms.json", capture(frame("b.png") + "," + bad));
    const std::string message = error_of([&] { read_scene(folder.path); });
    const Scene rest = read_scene(folder.path, {true});
    CHECK(rest.frames.size() == 1);
    CHECK(rest.warnings.size() == 1);
    return message;
  };
  const auto pose = [](const std::string& first) { return "[[" + first + ",0,0,2],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]"; };
  for (const char* value : {"NaN", "-Infinity", "null", "\"1\"", "[]"}) {
    const std::string message = attempt(frame("a.png", pose(value)));
    CHECK_MESSAGE(holds(message, "frame 1 (a.png): transform_matrix[0][0]"), message);
  }
  CHECK(holds(attempt(frame("a.png", pose("-1"))), "mirrored"));
  CHECK(holds(attempt(frame("a.png", pose("0"))), "determinant 0"));
  CHECK(holds(attempt(frame("a.png", pose("1.2"))), "not hold a rotation"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0,1e300],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]")), "position"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0],[0,1,0],[0,0,1]]")), "transform_matrix[0]"));
  CHECK(holds(attempt(frame("a.png", "[[1,0,0,0]]")), "has 1 rows"));
  CHECK(holds(attempt(R"({"file_path":"a.png"})"), "transform_matrix is missing"));
  CHECK(holds(attempt(R"({"transform_matrix":)" + kPose + "}"), "file_path is missing"));
  CHECK(holds(attempt(R"({"file_path":7,"transform_matrix":)" + kPose + "}"), "want a string"));
  CHECK(holds(attempt("[]"), "frame 1"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"fl_x":0)")), "fx 0"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"w":7.5)")), "w is 7.5"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"camera_model":"EQUIRECTANGULAR")")), "EQUIRECTANGULAR"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"mask_path":"no.png")")), "no.png"));
  CHECK(holds(attempt(frame("a.png", kPose, R"(,"mask_path":"../b.png")")), "leaves the data folder"));
}

TEST_CASE("bad files stop with the place named") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const auto attempt = [&](const std::string& content) {
    folder.text_file("transforms.json", content);
    return error_of([&] { read_scene(folder.path); });
  };
  CHECK(holds(attempt("{\n \"w\": 8,\n oops }"), "line 3"));
  CHECK(holds(attempt("{\n \"frames\": [],\n \"w\": 1e999}"), "line 3, column 7"));
  CHECK(holds(attempt(R"({"w":8,"w":9,"frames":[]})"), "\"w\" appears twice"));
  CHECK(holds(attempt(std::string(100000, '[')), "nested deeper"));
  CHECK(holds(attempt(R"({"frames":[],"w":)" + std::string(64, '[')), "nested deeper than 64"));
  CHECK(holds(attempt(R"({"frames":[],"w":)" + std::string(63, '[')), "unexpected end of input"));
  CHECK(attempt(R"({"w":")" + std::string(100000, 'a')).size() < 1000);
  CHECK(holds(attempt("{}"), "frames is missing"));
  CHECK(holds(attempt(capture("")), "no usable image: 0 listed"));
  CHECK(holds(attempt(capture(frame("gone.png"))), "1 missing (first: gone.png)"));
  CHECK(holds(attempt(capture(frame("a.png"), R"("w":8)")), "looked for fl_x"));
  CHECK(holds(attempt(capture(frame("a.png"), R"("camera_angle_x":3.2)")), "camera_angle_x"));
  CHECK(holds(attempt("\xff\xfe{"), "line 1"));
  CHECK(holds(attempt(""), "line 1"));
}

TEST_CASE("transforms.json cut short at any byte gives an Error, never anything else") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const std::string all = capture(frame("a.png", kPose, R"(,"mask_path":"a.png","k1":NaN)"));
  for (std::size_t length = 0; length <= all.size(); ++length) {
    folder.text_file("transforms.json", all.substr(0, length));
    CHECK_THROWS_AS(read_scene(folder.path), Error);
  }
}

TEST_CASE("transforms.json with any byte replaced reads or gives an Error") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  const std::string all = capture(frame("a.png"), R"("fl_x":10,"w":8,"h":6,"k1":0.1,"camera_model":"OPENCV")");
  for (std::size_t at = 0; at < all.size(); ++at) {
    for (const char put : {'0', '9', '"', '-', ']', '{', 'N', '\0', '\xff'}) {
      std::string changed = all;
      changed[at] = put;
      folder.text_file("transforms.json", changed);
      try {
        load_images(read_scene(folder.path), Split::train);
      } catch (const Error&) {}
    }
  }
}

TEST_CASE("damaged images stop the load with the file named, or are dropped") {
  const Capture folder;
  folder.image("a.png", 8, 6, {1, 2, 3});
  folder.image("b.png", 8, 6, {1, 2, 3});
  fs::resize_file(folder.path / "b.png", fs::file_size(folder.path / "b.png") - 20);
  folder.text_file("transforms.json", capture(frame("a.png") + "," + frame("b.png")));
  const Scene scene = read_scene(folder.path);
  CHECK(holds(error_of([&] { load_images(scene, Split::train); }), "b.png"));
  const Pixels rest = load_images(scene, Split::train, {1, true});
  CHECK(rest.frames.size() == 1);
  CHECK(rest.warnings.size() == 1);
}
