// cloam selftest: it names a kernel that is wrong, switches its family off where the reference is right, and a device
// that computes wrong results is refused.
#include <doctest/doctest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "runtime/device.h"
#include "runtime/verdict.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A folder of kernels of which one has another text: "NAME=value" for the program. The rest is as it was built in.
std::string kernels_with(const std::string& stem, const std::string& old_text, const std::string& new_text) {
  const fs::path folder = scratch() / ("kernels-" + stem);
  std::string source = content_of(fs::path(CLOAM_SOURCE) / "kernels" / (stem + ".cl"));
  const size_t at = source.find(old_text);
  REQUIRE_MESSAGE(at != std::string::npos, old_text);
  fs::create_directories(folder);
  write_text(folder / (stem + ".cl"), source.replace(at, old_text.size(), new_text));
  return "CLOAM_KERNEL_DIR=" + folder.string();
}

std::string cache_of(const std::string& name) { return "CLOAM_CACHE_DIR=" + (scratch() / name).string(); }

/// Keeps a verdict on this machine's device where the program will look for it.
void keep(const std::string& cache, const Verdict& verdict) {
  const std::string folder = cache.substr(cache.find('=') + 1);
  const char* const before = std::getenv("CLOAM_CACHE_DIR");
  const std::string kept = before ? before : "";
  setenv("CLOAM_CACHE_DIR", folder.c_str(), 1);
  fs::create_directories(folder);
  write_text(verdict_file(device()), file_text(verdict, device()));
  before ? setenv("CLOAM_CACHE_DIR", kept.c_str(), 1) : unsetenv("CLOAM_CACHE_DIR");
}

}  // namespace

TEST_CASE("selftest names a kernel that is wrong and switches its family off where the reference is right") {
  const std::string broken = kernels_with("max_pool_cpu", "y = top + 1;", "y = top + 2;");
  const Outcome outcome = cloam_with({"selftest", "--quick", "--only", "max_pool", "--json"}, {broken, cache_of("c1")});
  CHECK(outcome.code == 7);
  const nlohmann::json found = nlohmann::json::parse(outcome.out);
  CHECK(found["usable"] == true);
  REQUIRE(found["switched_off"].size() == 1);
  CHECK(found["switched_off"][0]["family"] == "max_pool");
  REQUIRE(!found["suspects"].empty());
  CHECK(contains(found["suspects"].dump(), "max_pool_cpu.cl: max_pool2d_planes"));
  const Outcome words = cloam_with({"selftest", "--quick", "--only", "max_pool"}, {broken, cache_of("c1")});
  CHECK(contains(words.out, "suspect: max_pool_cpu.cl: "));
  CHECK(contains(words.out, "switched off: the faster kernels of max_pool"));
}

TEST_CASE("selftest: a kernel that nothing can stand for makes the device unusable") {
  const std::string broken = kernels_with("unfold", "y >= 0 && y < H", "y > 0 && y < H");
  const Outcome outcome = cloam_with({"selftest", "--quick", "--only", "unfold", "--json"}, {broken, cache_of("c2")});
  CHECK(outcome.code == 7);
  const nlohmann::json found = nlohmann::json::parse(outcome.out);
  CHECK(found["usable"] == false);
  REQUIRE(!found["suspects"].empty());
  CHECK(contains(found["suspects"].dump(), "unfold.cl: unfold"));
  const Outcome report = cloam_with({"selftest", "--quick", "--only", "unfold", "--report"}, {broken, cache_of("c2")});
  CHECK(contains(report.out, "### selftest of " + device().name));
  CHECK(contains(report.out, "FAIL  unfold"));
}

TEST_CASE("in float64 values agree to ten digits and more: no formula hides behind rounding") {
  const Outcome outcome = cloam_with({"selftest", "--quick", "--only", "matmul", "--only", "conv2d", "--only", "mlp",
                                      "--only", "hash_grid", "--only", "composite", "--only", "splat_blend", "--json"},
                                     {"CLOAM_DEBUG=float64", cache_of("c4")});
  CHECK_MESSAGE(outcome.code == 0, outcome.out, outcome.err);
  const nlohmann::json found = nlohmann::json::parse(outcome.out);
  CHECK(found["results"].size() > 50);
  for (const nlohmann::json& row : found["results"]) CHECK_MESSAGE(row["value_error"] < 1e-8, row.dump());
}

TEST_CASE("selftest refuses a row that does not exist, and keeps no verdict of a part") {
  const Outcome none = cloam_with({"selftest", "--only", "no-such-row"});
  CHECK(none.code == 2);
  CHECK(contains(none.err, "no op row's name contains \"no-such-row\""));
  CHECK(cloam_with({"selftest", "--quick", "--only", "relu", "-q"}, {cache_of("c3")}).code == 0);
  CHECK(!fs::exists(scratch() / "c3"));
}

TEST_CASE("a device that failed selftest is refused, and --force uses it with a warning") {
  const std::string cache = cache_of("c4");
  keep(cache, {"2026-01-02T03:04:05Z", true, 300, {"matmul: batched"}, {}});
  const fs::path run = scratch() / "run-on-a-wrong-device";
  const Words training = small_training(small_scene(), run, {"--steps", "2"});
  const Outcome refused = cloam_with(training, {cache});
  CHECK(refused.code == 4);
  CHECK(contains(refused.err, "failed 1 of 300 rows of selftest --quick on 2026-01-02, first \"matmul: batched\""));
  CHECK(!fs::exists(run));
  CHECK(contains(cloam_with({"info"}, {cache}).out, "WRONG RESULTS, failed 1 of 300 rows"));
  Words forced = training;
  forced.push_back("--force");
  const Outcome used = cloam_with(forced, {cache});
  CHECK_MESSAGE(used.code == 0, used.err);
  CHECK(contains(used.err, "used all the same (--force)"));
}

TEST_CASE("a family of kernels that selftest switched off runs its reference, and a training says so") {
  const std::string cache = cache_of("c5");
  keep(cache, {"2026-01-02T03:04:05Z", false, 300, {}, {{"mlp", "mlp: two hidden layers"}}});
  const Outcome told = cloam_with({"bench", "--explain", "mlp"}, {cache});
  CHECK_MESSAGE(told.code == 0, told.err);
  CHECK(contains(told.out, "selftest found the others wrong"));
  CHECK(contains(told.err, "the faster kernels of mlp are switched off on this device"));
  const nlohmann::json info = nlohmann::json::parse(cloam_with({"info", "--json"}, {cache}).out);
  CHECK(info["devices"][0]["selftest"]["switched_off"] == nlohmann::json::array({"mlp"}));
  const Words training = small_training(small_scene(), scratch() / "run-with-references", {"--steps", "2"});
  CHECK(contains(cloam_with(training, {cache}).err, "passed selftest on 2026-01-02, 1 kernel family switched off"));
  const Words untested = small_training(small_scene(), scratch() / "run-untested", {"--steps", "2"});
  CHECK(contains(cloam_with(untested, {cache_of("c6")}).err, "never tested: cloam selftest --quick"));
}

TEST_CASE("a damaged verdict counts as none") {
  const std::string cache = cache_of("c7");
  keep(cache, {"2026-01-02T03:04:05Z", true, 300, {"matmul: batched"}, {}});
  for (const fs::directory_entry& file : fs::directory_iterator(scratch() / "c7")) write_text(file, "garbage\n");
  CHECK(contains(cloam_with({"info"}, {cache}).out, "never tested"));
}
