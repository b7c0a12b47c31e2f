// Readers of captures: paths and links, in lists and on disk.
#include <doctest/doctest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "models/data/load_images.h"
#include "models/data/near_misses.h"
#include "models/data/read_scene.h"
#include "models/data/write_transforms.h"
#include "models/scene/split.h"
#include "runtime/error.h"
#include "tests/models/capture.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

TEST_CASE(
    "a path that leaves the folder needs the user's leave, and the error is the same whether or not it is there") {
  const Capture outside;
  const Capture folder;
  outside.image("real.png", 8, 6, {1, 2, 3});
  folder.image("a.png", 8, 6, {4, 5, 6});
  const std::string up = "../" + outside.path.filename().string();
  const auto read = [&](const std::string& path, const ReadOptions& options = {}) {
    folder.text_file("transforms.json", capture(frame(path)));
    return read_scene(folder.path, options);
  };
  const auto refusal = [&](const std::string& path) {
    const std::string message = error_of([&] { read(path); });
    CHECK_MESSAGE(holds(message, "leaves the data folder"), message);
    CHECK_MESSAGE(holds(message, "--allow-outside"), message);
    return message.substr(0, message.find(path)) + message.substr(message.find(path) + path.size());
  };
  for (const std::string& folder_out : {up, outside.path.string()})
    CHECK(refusal(folder_out + "/real.png") == refusal(folder_out + "/gone.png"));
  for (const char* path : {"images/../../x", "..", "/dev/zero", "/etc/hostname", "/"}) refusal(path);
  folder.text_file("transforms.json", capture(frame("a.png", kPose, R"(,"mask_path":")" + up + R"(/real.png")")));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "--allow-outside"));

  const ReadOptions allowed{false, true};
  for (const std::string& path : {up + "/real.png", (outside.path / "real.png").string()}) {
    const Scene scene = read(path, allowed);
    CHECK(scene.frames.at(0).image == path);
    CHECK(load_images(scene, Split::train).frames.at(0).rgba[0] == 1);
  }
  CHECK(holds(error_of([&] { read("/dev/zero", allowed); }), "is not a regular file"));
  CHECK(holds(error_of([&] { load_images(read("/etc/hostname", allowed), Split::train); }), "want a PNG"));
  CHECK(holds(error_of([&] { read("", allowed); }), "transforms.json, frame 0: file_path is empty"));
  CHECK(holds(error_of([&] { read("a\\u0000b", allowed); }), "control character"));
  CHECK(holds(error_of([&] { read(std::string(5000, 'a'), allowed); }), "5000 characters"));
}

TEST_CASE("absolute paths and .. that stay in the folder need nothing") {
  const Capture folder;
  folder.image("images/a.png", 8, 6, {1, 2, 3});
  const std::string other_name = folder.path.string() + "-link";
  fs::create_directory_symlink(folder.path, other_name);
  for (const fs::path& path :
       {folder.path / "images/a.png", fs::path(other_name) / "images/a.png", fs::path("images/../images/a.png"),
        fs::path("./images//a.png"), fs::path("..") / folder.path.filename() / "images/a.png"}) {
    folder.text_file("transforms.json", capture(frame(path.string())));
    CHECK(read_scene(folder.path).frames.at(0).image == "images/a.png");
    CHECK(read_scene(other_name).frames.at(0).image == "images/a.png");
  }
  fs::remove(other_name);
}

TEST_CASE("a list from another machine: the file that the folder has is named before any leave is asked for") {
  const Capture folder;
  folder.image("images/a.png", 8, 6, {1, 2, 3});
  for (const char* path : {"/home/joe/walk/images/a.png", "../walk/images/a.png", "/a/../b/images/a.png"}) {
    folder.text_file("transforms.json", capture(frame(path)));
    const std::string message = error_of([&] { read_scene(folder.path); });
    CHECK_MESSAGE(holds(message, folder.path.string() + ", which has images/a.png: "), message);
    CHECK_MESSAGE(holds(message, "fix: write images/a.png there"), message);
  }
}

TEST_CASE("nerfstudio: names in lists may begin with ./; others are told; what no list names is not used") {
  const Capture folder;
  for (const char* name : {"images/a.png", "images/b.png", "images/c.png", "images/d.png"})
    folder.image(name, 8, 6, {1, 2, 3});
  const auto read = [&](const std::string& lists) {
    folder.text_file("transforms.json",
                     capture(frame("images/a.png") + "," + frame("./images/b.png") + "," + frame("images/c.png") + "," +
                                 frame("images/d.png") + "," + frame("images/gone.png"),
                             R"("fl_x":10,"w":8,"h":6,)" + lists));
    Scene scene = read_scene(folder.path);
    std::erase_if(scene.warnings,
                  [](const std::string& warning) { return holds(warning, "listed images are missing"); });
    return scene;
  };
  const auto splits = [](const Scene& scene) {
    std::string all;
    for (const Frame& frame : scene.frames)
      all += frame.split == Split::train ? 't' : frame.split == Split::test ? 'e' : '-';
    return all;
  };
  Scene scene = read(R"("test_filenames":["./images/a.png","images/b.png","images/gone.png"])");
  CHECK(splits(scene) == "eett");
  CHECK(scene.warnings.empty());
  scene =
      read(R"("train_filenames":["images/a.png"],"test_filenames":["images/b.png"],"val_filenames":["images/c.png"])");
  CHECK(splits(scene) == "te--");
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "2 of 4 images are not used: train_filenames leaves them out"));
  write_transforms(folder.path / "again", scene);
  CHECK(splits(read_scene(folder.path / "again")) == "te--");
  CHECK(splits(read(R"("train_filenames":["images/a.png","images/d.png"])")) == "t--t");
  CHECK(splits(read(R"("val_filenames":["images/c.png"])")) == "ttet");
  CHECK(splits(read(R"("test_filenames":["images/b.png"],"val_filenames":["images/c.png"])")) == "te-t");
  scene = read(R"("test_filenames":["a.png","b.png"])");
  CHECK(splits(scene) == "tttt");
  REQUIRE(scene.warnings.size() == 1);
  CHECK(holds(scene.warnings[0], "transforms.json: 2 names in test_filenames are the file_path of no frame (a.png, "));
  CHECK(holds(scene.warnings[0], "such as images/a.png"));
}

TEST_CASE("links to folders and to images are followed wherever they lead") {
  const Capture outside;
  const Capture folder;
  outside.image("photos/real.png", 8, 6, {1, 2, 3});
  outside.image("mask.png", 8, 6, {0});
  fs::copy_file(outside.path / "mask.png", outside.path / "5c1e2f");  // as caches name their files
  fs::create_directory_symlink(outside.path / "photos", folder.path / "images");
  fs::create_symlink("images/real.png", folder.path / "near.png");
  fs::create_symlink(outside.path / "5c1e2f", folder.path / "mask.png");
  folder.text_file("transforms.json", capture(frame("images/real.png", kPose, R"(,"mask_path":"mask.png")") + "," +
                                              frame("near.png") + "," + frame("mask.png")));
  const Pixels pixels = load_images(read_scene(folder.path), Split::train);
  REQUIRE(pixels.frames.size() == 3);
  CHECK(pixels.frames[0].rgba[0] == 1);
  CHECK(pixels.frames[0].mask[0] == 0);
  CHECK(pixels.frames[2].rgba[0] == 0);
}

TEST_CASE("links to what is no image are refused without a word of its content") {
  const Capture outside;
  const Capture folder;
  const std::string secret = "password hunter2";
  outside.text_file("secret", secret);
  REQUIRE(mkfifo((outside.path / "pipe").c_str(), 0600) == 0);
  folder.text_file("transforms.json", capture(frame("a.png")));
  for (const fs::path& target :
       {outside.path / "secret", outside.path / "pipe", fs::path("/dev/zero"), fs::path("/dev/tty"),
        fs::path("/proc/self/environ"), outside.path, fs::path("a.png")}) {
    CAPTURE(target);
    fs::remove(folder.path / "a.png");
    fs::create_symlink(target, folder.path / "a.png");
    const std::string message = error_of([&] { load_images(read_scene(folder.path), Split::train); });
    CHECK_MESSAGE(holds(message, "a.png: "), message);
    CHECK_FALSE(holds(message, "hunter2"));
  }
  fs::remove(folder.path / "a.png");
  fs::create_symlink(outside.path / "gone.png", folder.path / "a.png");
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "a.png is a link to a missing file"));
  for (const char* name : {"transforms.json", "rig.json"}) {
    fs::remove(folder.path / "transforms.json");
    fs::create_symlink(outside.path / "secret", folder.path / name);
    const std::string message = error_of([&] { read_scene(folder.path); });
    CHECK_MESSAGE(holds(message, "the file that this link leads to"), message);
    CHECK_FALSE(holds(message, "pass"));
  }
}

TEST_CASE("images that are missing by their names alone are named with the names they have") {
  const Capture folder;
  folder.image("Images/a.png", 8, 6, {1, 2, 3});
  folder.image("images/c.png", 8, 6, {1, 2, 3});
  fs::rename(folder.path / "images/c.png", folder.path / "images/C.PNG");
  folder.text_file("images/d.heic", "");
  folder.image("elsewhere/e.png", 8, 6, {1, 2, 3});
  folder.image("there.png", 8, 6, {1, 2, 3});
  const auto warned = [&](const std::string& names) {
    folder.text_file("transforms.json", capture(frame("there.png") + "," + names));
    return read_scene(folder.path).warnings.at(0);
  };
  CHECK(holds(warned(frame("images/c.png")), "images/C.PNG is there instead of images/c.png: rename the files"));
  CHECK(holds(warned(frame("images/a.png")), "Images/a.png is there instead of images/a.png"));
  CHECK(holds(warned(frame("images/c.jpg") + "," + frame("images/a.png")), "(and 1 more like it)"));
  CHECK(holds(warned(frame("images/d.jpg")), "images/d.heic is there instead of images/d.jpg: convert HEIC"));
  CHECK(holds(warned(frame("photos/e.png")), "elsewhere/e.png is there instead of photos/e.png"));
  CHECK(holds(warned(frame("images\\\\c.png")), "images/C.PNG is there instead of images\\c.png"));
  CHECK(holds(warned(frame("e.png")), "elsewhere/e.png is there instead of e.png"));
  CHECK_FALSE(holds(warned(frame("images/e.png")), "instead"));  // the folder is right, so another folder's is another
  folder.image("images/a b.png", 8, 6, {1, 2, 3});
  folder.image("images/Ce\u0301zanne.png", 8, 6, {1, 2, 3});  // as macOS writes an e with an accent
  CHECK(holds(warned(frame("images/a%20b.png")), "images/a b.png is there instead of images/a%20b.png"));
  CHECK(holds(warned(frame("images/C\u00e9zanne.png")),
              "zanne.png is there instead of images/C\u00e9zanne.png: the accents"));
  CHECK_FALSE(holds(warned(frame("images/Cezannes.png")), "instead"));
  folder.text_file("notes.txt", "");
  CHECK_FALSE(holds(warned(frame("words/notes.png")), "instead"));  // no image
  fs::create_directories(folder.path / "photos");
  CHECK(holds(warned(frame("photos/e.png")), "elsewhere/e.png is there instead of photos/e.png"));
  CHECK(near_misses(folder.path, {"photos/e.png"}, false).empty());
  CHECK(near_misses(folder.path, {"there.png"}).empty());  // never the file itself
  folder.text_file("transforms.json", capture(frame("images/c.png")));
  CHECK(holds(error_of([&] { read_scene(folder.path); }), "images/C.PNG is there instead"));
}
