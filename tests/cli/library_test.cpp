// The installed library: found by CMake and by pkg-config from a clean prefix, by programs that lie outside of the
// tree, which give what the program gives.
#include <doctest/doctest.h>

#include <cstdlib>
#include <sstream>

#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

fs::path folder() { return scratch() / "library"; }

/// Exit code and what a command of the shell's prints.
Outcome shell(const std::string& command) {
  const fs::path out = folder() / "out";
  const int status = std::system(("(" + command + ") >" + out.string() + " 2>&1").c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, content_of(out), "", 0};
}

void must(const std::string& command) {
  const Outcome outcome = shell(command);
  REQUIRE_MESSAGE(outcome.code == 0, command, "\n", outcome.out);
}

/// Installed, and the examples built with it, once.
const fs::path& built() {
  static const fs::path place = [] {
    fs::create_directories(folder());
    const std::string prefix = (folder() / "prefix").string(), source = (folder() / "source").string(),
                      programs = (folder() / "programs").string();
    fs::copy(fs::path(CLOAM_SOURCE) / "examples" / "library", source);  // no header of the tree lies beside it
    const std::string build = fs::path(CLOAM_BINARY).parent_path().parent_path().string();
    must("cmake --install " + build + " --prefix " + prefix + " --component library");
    must("cmake -S " + source + " -B " + programs + " -DCMAKE_PREFIX_PATH=" + prefix);
    must("cmake --build " + programs);
    return fs::path(programs);
  }();
  return place;
}

std::string program(const std::string& name) { return (built() / name).string(); }

/// The picture of the first held-out view.
std::string first_of(const fs::path& pictures) {
  std::string first;
  for (const auto& entry : fs::directory_iterator(pictures))
    if (first.empty() || entry.path().string() < first) first = entry.path().string();
  return content_of(first);
}

}  // namespace

TEST_CASE("library: a tensor program with a gradient, found by CMake and by pkg-config") {
  const Outcome by_cmake = shell(program("fit_line"));
  CHECK(by_cmake.code == 0);
  CHECK_MESSAGE(contains(by_cmake.out, "y = 2.000 x + 1.000, on "), by_cmake.out);
  const std::string config = (folder() / "prefix/lib/pkgconfig").string(), alone = (folder() / "fit_alone").string();
  must("export PKG_CONFIG_PATH=" + config + "; c++ " + (folder() / "source/fit_line.cpp").string() +
       " $(pkg-config --cflags --libs cloam) -o " + alone);
  CHECK(shell(alone).out == by_cmake.out);
  const Outcome no_device = shell("CLOAM_DEVICE=none " + alone);
  CHECK(no_device.code == 4);
  CHECK_MESSAGE(contains(no_device.out, "none"), no_device.out);
}

TEST_CASE("library: a run is loaded, edited and rendered to the bytes of edit and render") {
  const std::string picture = (folder() / "moved.png").string();
  const fs::path run = folder() / "street", as_it_is = folder() / "as-it-is", moved = folder() / "moved",
                 edited = folder() / "edited";
  const std::string move = program("move_actor") + " " + run.string() + " " + picture;
  Words words = {"train", "street-gaussians", small_street().string(), "-o", run.string()};
  const char* const more = "-q --preset street-gaussians-small --steps 2 --holdout 3 --pictures off";
  std::istringstream options(more);
  for (std::string option; options >> option;) words.push_back(option);
  for (const char* setting : {"initial.lidar=2000", "initial.actor=500", "initial.fewest=500", "sky.side=4"})
    words.insert(words.end(), {"--set", setting});
  const Outcome trained = cloam_with(words);
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  must(move);
  REQUIRE(cloam_with({"render", run.string(), "-o", as_it_is.string()}).code == 0);
  CHECK(content_of(picture) == first_of(as_it_is));
  std::string seen;  // an actor whose place changes the picture
  const auto scene = json_of(run / "scene.json").at("scenes").at(0);
  for (const auto& actor : scene.at("actors")) {
    seen = actor.at("id");
    must(move + " " + seen + " 3");
    if (content_of(picture) != first_of(as_it_is)) break;
  }
  REQUIRE(content_of(picture) != first_of(as_it_is));
  const Outcome edit = cloam_with({"edit", run.string(), "--actor", seen + ":shift=3,0,0", "-o", edited.string()});
  REQUIRE_MESSAGE(edit.code == 0, edit.err);
  REQUIRE(cloam_with({"render", edited.string(), "-o", moved.string()}).code == 0);
  CHECK(content_of(picture) == first_of(moved));
}

TEST_CASE("library: errors are exceptions that say what the program says") {
  const Outcome outcome = shell(program("move_actor") + " " + (folder() / "no-run").string() + " never.png");
  CHECK(outcome.code == 2);
  const Outcome same = cloam_with({"render", (folder() / "no-run").string(), "-o", (folder() / "never").string()});
  CHECK_MESSAGE(contains(same.err, outcome.out.substr(0, outcome.out.find('\n'))), same.err, outcome.out);
}
