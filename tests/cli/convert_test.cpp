// convert: every format to every other, figures of what was lost, exit codes.
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Three points of a cloud with z up, as text.
fs::path points() {
  const fs::path path = scratch() / "points.ply";
  write_text(path,
             "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
             "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
             "1 2 3 255 128 0\n1 2 4 0 0 0\n1 5 4 9 9 9\n");
  return path;
}

nlohmann::json converted(const fs::path& in, const fs::path& out, Words more = {}) {
  Words words = {"convert", in.string(), out.string(), "--json"};
  words.insert(words.end(), more.begin(), more.end());
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return nlohmann::json::parse(outcome.out);
}

}  // namespace

TEST_CASE("convert goes through all formats and back, and says what was lost") {
  fs::path before = points();
  Words up = {"--up", "z"};
  for (const char* extension : {"ply", "glb", "spz", "splat", "spz", "ply"}) {
    const fs::path after = scratch() / ("after-" + before.extension().string().substr(1) + "." + extension);
    const nlohmann::json json = converted(before, after, up);
    CHECK(json.at("schema_version") == 1);
    CHECK(json.at("gaussians") == 3);
    CHECK(json.at("position_error").get<double>() < 1e-4);
    CHECK(json.at("colour_error").get<double>() < 0.005);
    CHECK(json.at("rotation_error_degrees").get<double>() < 0.8);
    if (after.extension() == ".ply") CHECK(json.at("opacity_error") == 0);
    if (!up.empty()) CHECK(json.at("up") == nlohmann::json({0, 0, 1}));
    before = after;
    up.clear();
  }
  // z was up, y is now: (1, 2, 3) became (1, 3, -2), whatever lay between.
  const std::string last = content_of(before);
  CHECK(contains(last, "comment up 0 1 0\n"));
  const std::size_t start = last.find("end_header\n") + 11;
  float place[3];
  std::memcpy(place, last.data() + start, sizeof place);
  CHECK(std::abs(place[0] - 1) < 1e-4f);
  CHECK(std::abs(place[1] - 3) < 1e-4f);
  CHECK(std::abs(place[2] + 2) < 1e-4f);
}

TEST_CASE("convert: what cannot be done has its exit code and leaves no file") {
  const fs::path out = scratch() / "not-made.spz", ksplat = scratch() / "some.ksplat";
  write_text(ksplat, std::string(5000, '\1'));
  const auto refused = [&](const Words& words, int code, const std::string& reason) {
    const Outcome outcome = cloam_with(words);
    CHECK(outcome.code == code);
    CHECK_MESSAGE(contains(outcome.err, reason), outcome.err);
    CHECK_FALSE(fs::exists(out));
  };
  refused({"convert", ksplat.string(), out.string()}, 3, ".ksplat is not supported");
  refused({"convert", (scratch() / "no.ply").string(), out.string()}, 3, "no such file");
  refused({"convert", points().string(), (scratch() / "a.obj").string()}, 2,
          "cannot write .obj; supported: .compressed.ply, .ply, ");
  refused({"convert", points().string(), (scratch() / "a.ksplat").string()}, 2, "cannot be written");
  refused({"convert", points().string(), out.string(), "--up", "up"}, 2, "want one of x, y, z");
  refused({"convert", points().string(), out.string(), "--spz-version", "4"}, 2, "spz-version");
}
