// cloam view --html: what the file holds. How it looks is tested in a browser (tests/browser).
#include <doctest/doctest.h>

#include "models/gaussians/formats.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// What an element of the page holds; "" where there is none.
std::string element(const std::string& page, const std::string& id) {
  const std::size_t name = page.find("id=\"" + id + "\">");
  if (name == std::string::npos) return "";
  const std::size_t begin = page.find('>', name) + 1;
  return page.substr(begin, page.find('<', begin) - begin);
}

Gaussians one_gaussian() {
  Gaussians g;
  g.means = {1, 2, 3};
  g.scales = {-2, -2, -2};
  g.rotations = {1, 0, 0, 0};
  g.opacities = {2};
  g.sh_first = {1, 0, 0};
  g.sh_rest = std::vector<float>(3 * kSphericalRest, 0.f);
  return g;
}

}  // namespace

TEST_CASE("view --html of a method without Gaussians holds pictures around what the photos show") {
  const fs::path file = scratch() / "around.html";
  const Outcome written = cloam_with({"view", small_run().string(), "--html", file.string(), "--json"});
  REQUIRE_MESSAGE(written.code == 0, written.err);
  CHECK(nlohmann::json::parse(written.out)["bytes"] == fs::file_size(file));
  const nlohmann::json scene = nlohmann::json::parse(element(content_of(file), "stored-scene"));
  REQUIRE(scene["tour"].size() == 48);
  for (const auto& view : scene["tour"])
    CHECK(view["picture"].get<std::string>().starts_with("data:image/jpeg;base64,"));
  CHECK(scene["tour"][0]["picture"] != scene["tour"][24]["picture"]);
  CHECK(scene["cameras"][0]["photo"].is_null());
}

TEST_CASE("view --html of Gaussians holds them, if the build could bundle what draws them") {
  const fs::path splats = scratch() / "<!--<script>.ply", file = scratch() / "splats.html";
  write_gaussians(splats, one_gaussian());
  const Outcome written = cloam_with({"view", splats.string(), "--html", file.string()});
  if (written.code != 0) {
    CHECK(written.code == 2);
    CHECK(contains(written.err, "npm"));
    CHECK(!fs::exists(file));
    return;
  }
  const std::string page = content_of(file);
  const nlohmann::json scene = nlohmann::json::parse(element(page, "stored-scene"));
  CHECK(scene["title"] == "<!--<script>.ply");
  CHECK(element(page, "stored-splats").starts_with("H4sI"));  // gzip, as .spz is
}

TEST_CASE("view --html leaves no file where it cannot write one") {
  CHECK(cloam_with({"view", small_run().string(), "--html", "-"}).code == 2);
  CHECK(cloam_with({"view", small_run().string(), "--html", scratch().string()}).code == 2);
}
