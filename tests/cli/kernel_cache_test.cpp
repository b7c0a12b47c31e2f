// Without a folder of its own for compiled kernels the program takes a temporary one, says so, and works.
#include <doctest/doctest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <functional>

#include "tests/cli/process.h"
#include "tests/small_disk.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Empty is as unset.
Words environment(const fs::path& temporary, const Words& more) {
  Words all = {"TMPDIR=" + temporary.string()};
  for (const char* name : {"HOME=", "XDG_CACHE_HOME=", "POCL_CACHE_DIR="}) {
    std::string line = name;
    for (const std::string& word : more)
      if (word.starts_with(name)) line = word;
    all.push_back(line);
  }
  return all;
}

fs::path kernels_in(const fs::path& temporary) { return temporary / ("cloam-kernels-" + std::to_string(geteuid())); }

}  // namespace

TEST_CASE("an empty POCL_CACHE_DIR is as none") {
  const fs::path home = scratch() / "home-of-kernels";
  fs::create_directories(home);
  const Outcome outcome = cloam_with({"info"}, environment(scratch(), {"HOME=" + home.string()}));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK_FALSE(contains(outcome.err, "compiled kernels are kept in"));
}

TEST_CASE("no folder for compiled kernels: a temporary one serves, for this user alone, and a line says so") {
  write_text(scratch() / "no-folder", "");
  const std::string file = (scratch() / "no-folder").string();
  int number = 0;
  for (const Words& places : std::vector<Words>{{},
                                                {"HOME=/proc"},
                                                {"HOME=" + file},
                                                {"HOME=/proc", "XDG_CACHE_HOME=" + file},
                                                {"POCL_CACHE_DIR=/proc/kernels"}}) {
    const fs::path temporary = scratch() / ("temporary" + std::to_string(number++));
    fs::create_directories(temporary);
    const Outcome outcome = cloam_with({"info"}, environment(temporary, places));
    CHECK_MESSAGE(outcome.code == 0, outcome.err);
    const std::string line = "compiled kernels are kept in " + kernels_in(temporary).string();
    CHECK_MESSAGE(contains(outcome.err, line), outcome.err);
    struct stat found {};
    REQUIRE(stat(kernels_in(temporary).c_str(), &found) == 0);
    CHECK((found.st_mode & 0777) == 0700);
  }
}

TEST_CASE("kernels are compiled into the temporary folder") {
  const fs::path temporary = scratch() / "compiled";
  const std::string photos = (small_scene() / "test").string();
  fs::create_directories(temporary);
  const Outcome outcome = cloam_with({"distance", photos, photos, "--features", "random"},  // few kernels
                                     environment(temporary, {"HOME=/proc"}));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(outcome.err, kernels_in(temporary).string()));
  CHECK_FALSE(fs::is_empty(kernels_in(temporary)));
}

TEST_CASE("compiled kernels that are no longer whole are compiled again, and a line says so") {
  const fs::path temporary = scratch() / "damaged", cache = scratch() / "damaged-kernels";
  fs::create_directories(temporary);
  const Words places = environment(temporary, {"POCL_CACHE_DIR=" + cache.string()});
  const Words command = {"selftest", "--only", "negate", "--device", "Portable"};  // four kernels
  const Outcome sound = cloam_with(command, places);
  REQUIRE_MESSAGE(sound.code == 0, sound.err);
  const auto any = [&](const std::string& extension) {
    for (const auto& entry : fs::recursive_directory_iterator(cache))
      if (entry.path().extension() == extension) return entry.path();
    return fs::path();
  };
  using Damage = std::function<void(const fs::path&)>;
  for (const auto& [what, damage] : std::vector<std::pair<const char*, Damage>>{
           {"empty", [](const fs::path& file) { fs::resize_file(file, 0); }},
           {"cut in the middle", [](const fs::path& file) { fs::resize_file(file, fs::file_size(file) / 2); }},
           {"without its end", [](const fs::path& file) { fs::resize_file(file, fs::file_size(file) - 4); }},
           {"zeros", [](const fs::path& file) { write_text(file, std::string(fs::file_size(file), '\0')); }}})
    for (const char* extension : {".so", ".bc"}) {
      CAPTURE(what);
      CAPTURE(extension);
      REQUIRE(!any(extension).empty());
      damage(any(extension));
      const Outcome outcome = cloam_with(command, places);
      CHECK_MESSAGE(outcome.code == 0, outcome.code, outcome.err);
      CHECK(outcome.out == sound.out);
      CHECK_MESSAGE(contains(outcome.err, "1 compiled programs in " + cache.string() + " were damaged"), outcome.err);
    }
  CHECK_FALSE(contains(cloam_with(command, places).err, "damaged"));
}

TEST_CASE("a full disk under the folder for kernels") {
  const fs::path temporary = scratch() / "beside-full";
  fs::create_directories(temporary);
  const FullDisk disk(scratch() / "full-cache", 64);
  if (!disk.mounted()) {
    MESSAGE("skipped: no rights to mount");
    return;
  }
  const Outcome outcome =
      cloam_with({"info"}, environment(temporary, {"POCL_CACHE_DIR=" + (scratch() / "full-cache").string()}));
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "only 0 MB are free there"), outcome.err);
}

TEST_CASE("a temporary folder that others may write to is not trusted") {
  const fs::path temporary = scratch() / "shared";
  fs::create_directories(kernels_in(temporary));
  fs::permissions(kernels_in(temporary), fs::perms::all);
  const Outcome outcome = cloam_with({"info"}, environment(temporary, {"HOME=/proc"}));
  CHECK(outcome.code == 8);
  CHECK_MESSAGE(contains(outcome.err, "is not a private folder of this user"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "POCL_CACHE_DIR"), outcome.err);
  fs::remove(kernels_in(temporary));
  fs::create_directories(scratch() / "kernels-elsewhere");
  fs::create_directory_symlink(scratch() / "kernels-elsewhere", kernels_in(temporary));
  CHECK(cloam_with({"info"}, environment(temporary, {"HOME=/proc"})).code == 8);
  CHECK(fs::is_empty(scratch() / "kernels-elsewhere"));
}
