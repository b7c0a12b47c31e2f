// Commands that share their work out among ranks leave what one process leaves, byte for byte.
#include <doctest/doctest.h>
#include <signal.h>

#include <chrono>
#include <thread>

#include "tests/cli/mpirun.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Words with(Words words, const Words& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

/// An EXR says when it was written, at this place after a word.
std::string without_date(std::string bytes) {
  const std::string before = std::string("capDate") + '\0' + "string" + '\0';
  const size_t at = bytes.find(before), bytes_of_length = 4, date = 19;
  if (at != std::string::npos) bytes.erase(at + before.size() + bytes_of_length, date);
  return bytes;
}

void check_same(const std::map<std::string, std::string>& found, const std::map<std::string, std::string>& expected) {
  CHECK(!expected.empty());
  CHECK(found.size() == expected.size());
  for (const auto& [file, bytes] : expected) {
    CAPTURE(file);
    CHECK((found.contains(file) && without_date(found.at(file)) == without_date(bytes)));
  }
}

/// The command with `-o FOLDER`, by one process and by two ranks, leaves the same files. Returns what the ranks said.
Outcome check_same_files(const Words& command, const std::string& name) {
  const fs::path one = scratch() / (name + "_by_one"), two = scratch() / (name + "_by_two");
  const Outcome alone = cloam_with(with(command, {"-o", one.string()}));
  REQUIRE_MESSAGE(alone.code == 0, alone.err);
  const Outcome ranks = Ranks(2, with(command, {"-o", two.string()})).wait();
  REQUIRE_MESSAGE(ranks.code == 0, ranks.err);
  check_same(snapshot(two), snapshot(one));
  return ranks;
}

std::string without_seconds(const std::string& printed) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(printed);
  CHECK(json.erase("seconds") == 1);
  return json.dump(2);
}

/// What an evaluation leaves in the run's folder.
std::map<std::string, std::string> evaluation_of(const fs::path& run) {
  auto files = snapshot(run / "eval");
  files.at("eval.json") = without_seconds(files.at("eval.json"));
  return files;
}

/// An evaluation by one process and by three ranks, each of a copy of the run, finds and leaves the same.
void check_same_evaluation(const fs::path& run, const std::string& name, const Words& how) {
  CAPTURE(name);
  const fs::path one = copy_of(run, name + "_by_one"), three = copy_of(run, name + "_by_three");
  const Outcome alone = cloam_with(with({"eval", one.string(), "--json"}, how));
  REQUIRE_MESSAGE(alone.code == 0, alone.err);
  const Outcome ranks = Ranks(3, with({"eval", three.string(), "--json"}, how)).wait();
  REQUIRE_MESSAGE(ranks.code == 0, ranks.err);
  CHECK(without_seconds(ranks.out) == without_seconds(alone.out));
  check_same(evaluation_of(three), evaluation_of(one));
}

int lines_with(const std::string& text, const std::string& words) {
  int count = 0;
  for (size_t at = text.find(words); at != std::string::npos; at = text.find(words, at + 1)) ++count;
  return count;
}

const Words kManyPictures = {"--path", "orbit", "--frames", "5000"};

/// Two ranks that have each made a picture of many.
std::unique_ptr<Ranks> rendering(const fs::path& folder) {
  auto ranks = std::make_unique<Ranks>(2, with({"render", small_run().string(), "-o", folder.string()}, kManyPictures));
  const auto made = [&](const char* name) { return fs::exists(folder / name); };
  for (int i = 0; i < 600 && ranks->running() && !(made("orbit_0000.png") && made("orbit_0001.png")); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  REQUIRE_MESSAGE(ranks->running(), ranks->wait().err);
  return ranks;
}

}  // namespace

TEST_CASE("render shares pictures and sweeps out among ranks") {
  const Outcome film = check_same_files({"render", small_run().string(), "--path", "orbit", "--frames", "5"}, "orbit");
  CHECK(lines_with(film.err, "pictures in ") == 1);
  CHECK(lines_with(film.err, "orbit_0000") == 1);
  CHECK(lines_with(film.err, "orbit_0001") == 0);
  check_same_files({"render", small_street_run().string(), "--split", "all", "--masks", "--exr"}, "street_pictures");
  const Outcome sweeps =
      check_same_files({"render", small_street_run().string(), "--split", "all", "--lidar", "--json"}, "street_sweeps");
  CHECK(nlohmann::json::parse(sweeps.out).at("sweeps") == 3);  // one document
}

TEST_CASE("eval shares photos, sweeps and assets out among ranks") {
  check_same_evaluation(small_run(), "eval_photos", {"--features", "random"});
  check_same_evaluation(small_street_run(), "eval_street", {});
  check_same_evaluation(small_street_run(), "eval_turned", {"--protocol", "rotate360", "--features", "random"});
  check_same_evaluation(small_diffusion_run(), "eval_assets", {"--features", "random"});
}

TEST_CASE("generate shares assets out among ranks") {
  const Words generate = {"generate", small_diffusion_run().string(), "--steps", "2", "--size", "16"};
  const Outcome few = check_same_files(
      with(generate, {"-n", "5", "--pictures", "--frames", "2", "--resolution", "8", "--json"}), "made_few");
  CHECK(nlohmann::json::parse(few.out).at("assets").size() == 5);
  check_same_files(with(generate, {"-n", "67", "--no-meshes", "--frames", "1"}), "made_many");  // more than at once
}

TEST_CASE("simulate shares images and sweeps out among ranks, and leaves no half log when they are stopped") {
  check_same_files({"simulate", small_street_run().string()}, "simulated");
  check_same_files(
      {"simulate", two_streets_run().string(), "--augment", "2", "--prior", small_diffusion_run().string()},
      "augmented");
  const fs::path folder = scratch() / "simulated_in_part";
  Ranks ranks(2, {"simulate", small_street_run().string(), "-o", folder.string(), "--size", "640x360"});
  const fs::path images = folder / "camera" / "front_camera";
  for (int i = 0; i < 600 && ranks.running() && !(fs::exists(images / "00.jpg") && fs::exists(images / "01.jpg")); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  REQUIRE_MESSAGE(ranks.running(), ranks.wait().err);
  for (const pid_t process : ranks.processes()) REQUIRE(kill(process, SIGUSR1) == 0);
  const Outcome outcome = ranks.wait();
  CHECK(outcome.code == 128 + SIGUSR1);
  CHECK_MESSAGE(contains(outcome.err, " of 6 images and sweeps were made"), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, folder.string() + " was incomplete and has been removed"), outcome.err);
  CHECK_FALSE(fs::exists(folder));
}

TEST_CASE("a rank that fails at its part of the work ends all, and says why once") {
  const fs::path folder = scratch() / "one_part_fails";
  fs::create_directories(folder / "orbit_0003.png" / "in_the_way");
  const Outcome outcome = Ranks(2, with({"render", small_run().string(), "-o", folder.string()}, kManyPictures)).wait();
  CHECK(outcome.code == 8);
  CHECK_MESSAGE(contains(outcome.err, "error: rank 1 of 2: "), outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "orbit_0003.png"), outcome.err);
  CHECK(lines_with(outcome.err, "error: ") == 1);
  CHECK_FALSE(fs::exists(folder / "orbit_4999.png"));
}

TEST_CASE("a rank that is killed at its part of the work ends all") {
  const fs::path folder = scratch() / "one_part_killed";
  const auto ranks = rendering(folder);
  const pid_t lost = ranks->process_of(1);
  REQUIRE(lost > 0);
  REQUIRE(kill(lost, SIGKILL) == 0);
  const Outcome outcome = ranks->wait();
  CHECK(outcome.code != 0);
  CHECK_MESSAGE(contains(outcome.err, "rank 1 "), outcome.err);
  CHECK_FALSE(fs::exists(folder / "orbit_4999.png"));
}

TEST_CASE("ranks that are asked to stop end their pictures, and the first tells how many there are") {
  const fs::path folder = scratch() / "parts_stopped";
  const auto ranks = rendering(folder);
  for (const pid_t process : ranks->processes()) REQUIRE(kill(process, SIGUSR1) == 0);  // as mpirun passes it on
  const Outcome outcome = ranks->wait();
  CHECK(outcome.code == 128 + SIGUSR1);
  CHECK(lines_with(outcome.err, "stopping: finishing this picture") == 1);
  const auto files = snapshot(folder);
  CHECK_MESSAGE(contains(outcome.err, "stopped: " + std::to_string(files.size()) + " of 5000 pictures are complete in"),
                outcome.err);
  CHECK(lines_with(outcome.err, "stopped: ") == 1);
  for (const auto& [file, bytes] : files) CHECK(file.ends_with(".png"));
}

TEST_CASE("a rank that stands still at its part of the work is noticed and named, once the others are done") {
  const fs::path folder = scratch() / "one_part_stands_still";
  Ranks ranks(2, with({"render", small_run().string(), "-o", folder.string()}, {"--path", "orbit", "--frames", "300"}),
              {"CLOAM_RANK_TIMEOUT=5s"});
  for (int i = 0; i < 600 && ranks.running() && !fs::exists(folder / "orbit_0001.png"); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const pid_t stopped = ranks.process_of(1);
  REQUIRE(stopped > 0);
  REQUIRE(kill(stopped, SIGSTOP) == 0);
  const Outcome outcome = ranks.wait();
  CHECK_MESSAGE(outcome.code == 4, outcome.err);
  CHECK_MESSAGE(contains(outcome.err, "rank 1 has not finished a piece of its work for 5s"), outcome.err);
  CHECK(fs::exists(folder / "orbit_0298.png"));
}
