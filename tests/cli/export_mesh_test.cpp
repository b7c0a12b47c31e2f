// Surfaces of radiance fields through the program.
#include <doctest/doctest.h>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Of a field that has hardly learned, which is thin fog.
Outcome exported(const fs::path& file, const Words& more) {
  Words words = {"export", small_run().string(), "-o", file.string(), "--resolution", "24"};
  words.insert(words.end(), more.begin(), more.end());
  return cloam_with(words);
}

}  // namespace

TEST_CASE("export: the surface of a radiance field as glb, obj and ply, the same each time") {
  for (const char* name : {"fog.glb", "fog.obj", "fog.ply"}) {
    const fs::path file = scratch() / name, again = scratch() / (std::string("again-") + name);
    const Outcome outcome = exported(file, {"--level", "0.001", "--json"});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    const auto json = nlohmann::json::parse(outcome.out);
    CHECK(json.at("path") == file.string());
    CHECK(json.at("vertices").get<int>() > 100);
    CHECK(json.at("triangles").get<int>() > 100);
    CHECK(json.at("level") == 0.001);
    if (std::string(name) != "fog.glb") continue;
    REQUIRE(exported(again, {"--level", "0.001"}).code == 0);
    CHECK(content_of(again) == content_of(file));
  }
  CHECK(contains(content_of(scratch() / "fog.ply").substr(0, 4000), "comment world axes of the capture; up 0 0 1;"));
  CHECK(contains(content_of(scratch() / "fog.obj").substr(0, 4000), "\"level\":0.001"));
}

TEST_CASE("export: a field without a surface says so, and what a field has not is refused") {
  const fs::path file = scratch() / "none.glb";
  const Outcome thin = exported(file, {});
  CHECK(thin.code == 3);
  CHECK_MESSAGE(contains(thin.err, "there is no surface"), thin.err);
  CHECK(contains(thin.err, "--level"));
  CHECK(!fs::exists(file));
  CHECK(exported(file, {"--actor", "a"}).code == 2);
  CHECK(exported(file, {"--format", "turntable"}).code == 2);
  CHECK(exported(file, {"--format", "obj"}).code == 2);     // contradicts the name
  CHECK(exported(file, {"--format", "points"}).code == 2);  // likewise
  const Outcome background = exported(file, {"--background"});
  CHECK(background.code == 2);
  CHECK_MESSAGE(contains(background.err, "genassets"), background.err);
}
