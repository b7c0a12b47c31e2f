// Commands on a full disk, and places that cannot be written to: the right exit code, the disk or the reason in the
// message, nothing half-written.
#include <doctest/doctest.h>
#include <unistd.h>

#include "models/io/image.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"
#include "tests/small_disk.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Every file in the folder, those of 0 bytes and temporary ones counted double.
struct Left {
  std::size_t whole = 0, litter = 0;
};

Left left_in(const fs::path& folder) {
  Left left;
  if (!fs::exists(folder)) return left;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file() || entry.path().filename() == "filler") continue;
    const bool broken = entry.file_size() == 0 || contains(entry.path().filename().string(), ".tmp-");
    ++(broken ? left.litter : left.whole);
  }
  return left;
}

/// Commands that write into the folder `out`.
std::vector<Words> writing_commands(const fs::path& out) {
  return {
      {"render", small_run().string(), "-o", out.string(), "--path", "orbit", "--frames", "3", "--size", "96x96"},
      {"render", small_run().string(), "-o", out.string(), "--split", "all", "--exr", "--size", "96x96"},
      {"eval", small_run().string(), "--images", out.string()},
      {"synth", "-o", out.string(), "--logs", "1", "--frames", "1", "--size", "96x54"},
      {"edit", small_street_run().string(), "--list", "-o", out.string()},
      {"render", small_run().string(), "-o", (scratch() / "with-trace").string(), "--frames", "1", "--path", "orbit",
       "--profile-trace", (out / "trace.json").string()},
  };
}

}  // namespace

// Of commands without kernels: the OpenCL driver writes files of its own. tests/models holds every writer to the same.
TEST_CASE("files that may not grow: exit 8, and nothing broken is left") {
  const fs::path out = scratch() / "tight", cloud = scratch() / "cloud.ply";
  std::string points =
      "ply\nformat ascii 1.0\nelement vertex 500\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  for (int i = 0; i < 500; ++i) points += std::to_string(i * i % 97) + " " + std::to_string(i) + " 1 1 2 3\n";
  write_text(cloud, points);
  for (const Words& words : std::vector<Words>{
           {"synth", "-o", out.string(), "--logs", "1", "--frames", "1", "--size", "96x54", "-q"},
           {"convert", cloud.string(), (out / "cloud.spz").string()},
           {"convert", cloud.string(), (out / "cloud.glb").string()},
       }) {
    CAPTURE(words[0]);
    const Outcome outcome = [&] {
      const FileSizeLimit limit(900);
      return cloam_with(words);
    }();
    CHECK_MESSAGE(outcome.code == 8, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, "cannot write " + out.string()), outcome.err);
    CHECK(left_in(out).litter == 0);
  }
}

TEST_CASE("a full disk: exit 8 with its name and what is free on it") {
  small_street_run();
  const FullDisk disk(scratch() / "full", 64);
  if (!disk.mounted()) {
    MESSAGE("no rights to mount: the tests of files that may not grow stand for this one");
    return;
  }
  disk.fill();
  for (const Words& words : writing_commands(scratch() / "full")) {
    CAPTURE(words[0]);
    const Outcome outcome = cloam_with(words);
    CHECK_MESSAGE(outcome.code == 8, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, "0 bytes are free on " + fs::canonical(scratch() / "full").string() + ";"),
                  outcome.err);
    CHECK(left_in(scratch() / "full").litter == 0);
    CHECK(left_in(scratch() / "full").whole == 0);
  }
}

TEST_CASE("an edited run that finds the disk full is exit 8 and nothing of it is left") {
  const fs::path run = small_street_run();
  const std::string actor = json_of(run / "scene.json").at("scenes").at(0).at("actors").at(0).at("id");
  const fs::path edited = scratch() / "full-edit" / "run";
  const FullDisk disk(edited.parent_path(), 64);  // less than a checkpoint, more than what is written before it
  if (!disk.mounted()) {
    MESSAGE("skipped: no rights to mount");
    return;
  }
  const Outcome outcome = cloam_with({"edit", run.string(), "--actor", actor + ":remove", "-o", edited.string()});
  CHECK_MESSAGE(outcome.code == 8, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "bytes are free on "), outcome.err);
  CHECK(!fs::exists(edited));
}

TEST_CASE("a film that finds the disk full is exit 8 and no half a film stays") {
  const fs::path out = scratch() / "film", bin = scratch() / "film-bin";
  fs::create_directories(bin);
  write_text(bin / "ffmpeg", R"sh(#!/bin/sh
for film; do :; done
echo half > "$film"
echo "Error writing trailer of $film: No space left on device" >&2
case " $* " in *" -xerror "*) exit 1 ;; esac  # without it ffmpeg ends well all the same
)sh");
  fs::permissions(bin / "ffmpeg", fs::perms::owner_all);
  const Outcome outcome =
      cloam_with({"render", small_run().string(), "-o", out.string(), "--path", "orbit", "--frames", "2"},
                 {"PATH=" + bin.string()});
  CHECK_MESSAGE(outcome.code == 8, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "bytes are free on /"), outcome.err);
  CHECK(left_in(out).litter == 0);
  CHECK(left_in(out).whole == 3);  // two pictures and the GIF
}

TEST_CASE("a place to write to that is none: exit 2 before any work, and it stays as it was") {
  const fs::path file = scratch() / "a-file", folder = scratch() / "a-folder";
  write_text(file, "precious");
  fs::create_directories(folder);
  const std::string run = small_run().string(), inside = (file / "run").string();
  struct Row {
    Words words;
    const char* told;
  };
  for (const Row& row : std::vector<Row>{
           {{"render", run, "-o", "-"}, "name a folder"},
           {{"render", run, "-o", (scratch() / "orbit.gif").string(), "--path", "orbit"}, "name a folder for them"},
           {{"render", run, "-o", file.string()}, "is a file; name a folder"},
           {{"render", run, "-o", inside}, "is a file, not a folder"},
           {{"train", "nerf", small_scene().string(), "-o", "-"}, "name a folder"},
           {{"train", "nerf", small_scene().string(), "-o", file.string()}, "is a file; name a folder"},
           {{"train", "nerf", small_scene().string(), "-o", inside}, "is a file, not a folder"},
           {{"generate", run, "-o", "-"}, "name a folder"},
           {{"simulate", run, "-o", "-"}, "name a folder"},
           {{"simulate", run, "-o", inside}, "is a file, not a folder"},
           {{"synth", "-o", "-"}, "name a folder"},
           {{"demo", "-o", "-", "--features", "none"}, "name a folder"},
           {{"demo", "-o", file.string(), "--features", "none"}, "is a file; name a folder"},
           {{"edit", run, "--list", "-o", "-"}, "name a folder"},
           {{"process", run, "-o", "-"}, "name a folder"},
           {{"export", run, "-o", "-"}, "name a file or folder"},
           {{"export", run, "-o", inside}, "is a file, not a folder"},
           {{"convert", "a.ply", "-"}, "name a file"},
           {{"convert", "a.ply", folder.string()}, "is a folder; name a file"},
           {{"eval", run, "--images", file.string()}, "is a file; name a folder"},
           {{"render", run, "-o", folder.string(), "--profile-trace", folder.string()}, "is a folder; name a file"},
           {{"bench", "no such row", "--report", "/dev/null"}, "is a device or a pipe"},
       }) {
    std::string line;
    for (const std::string& word : row.words) line += " " + word;
    CAPTURE(line);
    const Outcome outcome = cloam_with(row.words);
    CHECK_MESSAGE(outcome.code == 2, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, row.told), outcome.err);
  }
  CHECK(content_of(file) == "precious");
  CHECK(fs::is_empty(folder));
  CHECK_FALSE(fs::exists("-"));
  CHECK_FALSE(fs::exists(scratch() / "orbit.gif"));
}

TEST_CASE("convert does not replace what it reads, by whatever name") {
  const fs::path file = scratch() / "own.ply";
  write_text(file,
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
             "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n0 0 0 1 2 3\n");
  const std::string before = content_of(file);
  fs::create_symlink(file, scratch() / "link.ply");
  fs::create_hard_link(file, scratch() / "other-name.ply");
  for (const char* out : {"own.ply", "link.ply", "other-name.ply"}) {
    const Outcome outcome = cloam_with({"convert", file.string(), (scratch() / out).string()});
    CHECK_MESSAGE(outcome.code == 2, outcome.err);
    CHECK_MESSAGE(contains(outcome.err, "is the input file"), outcome.err);
  }
  CHECK(content_of(file) == before);
  CHECK(fs::is_symlink(scratch() / "link.ply"));
}

TEST_CASE("export: the file's name says the format, or fits the one that is given") {
  const fs::path run = small_street_run();
  const std::string actor = json_of(run / "scene.json").at("scenes").at(0).at("actors").at(0).at("id");
  const auto exported = [&](const Words& more) {
    Words words = {"export", run.string(), "--resolution", "8"};
    words.insert(words.end(), more.begin(), more.end());
    return cloam_with(words);
  };
  const std::string mesh = (scratch() / "m.ply").string();
  const Outcome contradicts = exported({"--actor", actor, "--format", "glb", "-o", mesh});
  CHECK(contradicts.code == 2);
  CHECK_MESSAGE(contains(contradicts.err, "--format glb contradicts -o " + mesh), contradicts.err);
  CHECK(contains(exported({"--actor", actor, "-o", (scratch() / "m.stl").string()}).err,
                 "meshes are .glb, .obj or .ply"));
  const Outcome all = exported({"-o", (scratch() / "all.glb").string()});
  CHECK(all.code == 2);
  CHECK_MESSAGE(contains(all.err, "--actor ID"), all.err);
}

TEST_CASE("generate leaves a folder of pictures alone that is not its own, and its sheet shows more than the front") {
  const fs::path out = scratch() / "home";
  write_text((fs::create_directories(out / "pictures"), out / "pictures" / "wedding.jpg"), "precious");
  const Outcome outcome = cloam_with({"generate", small_diffusion_run().string(), "-o", out.string(), "--frames", "1",
                                      "--size", "16", "--no-meshes", "--pictures", "-q"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(content_of(out / "pictures" / "wedding.jpg") == "precious");
  const Image sheet = read_image(out / "grid.png"), front = read_image(out / "pictures" / "asset_000_0000.png");
  CHECK(sheet.height > 16 + 20);                                                            // a caption below it
  CHECK_FALSE(std::equal(front.pixels.begin(), front.pixels.end(), sheet.pixels.begin()));  // from a side too
}
