// cloam process with a stand-in for COLMAP: what it is asked, how it is watched, what is made of what it leaves; and
// with COLMAP itself where it is installed.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "models/io/image.h"
#include "tests/cli/process.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

// Answers as COLMAP 3.8 does. It places the first two photos in one model and all three in another.
const char* const kStandIn = R"sh(#!/bin/sh
command=$1
echo "$@" >> "$CALLS"
while [ $# -gt 0 ]; do
  case $1 in
    --output_path) out=$2 ;;
  esac
  shift
done
model() {
  mkdir -p "$1"
  for file in cameras images points3D; do cp "$MODELS/$2/$file.bin" "$1"; done
}
case $command in
  feature_extractor) echo "Processed file [1/3]"; echo "Processed file [3/3]" >&2 ;;
  exhaustive_matcher) echo "Matching block [1/1, 1/1] in 0.1s"; [ -z "$HANG" ] || { touch "$HANG"; sleep 60; } ;;
  mapper)
    [ -z "$FAIL" ] || { echo "Check failed: no luck"; exit 3; }
    echo "Registering image #2 (3)"
    [ -z "$NONE" ] || { echo "ERROR: failed to create sparse model"; exit 1; }
    model "$out/0" two
    model "$out/1" three ;;
esac
)sh";

template <class Value>
void add(std::string& bytes, std::initializer_list<Value> values) {
  for (const Value value : values) bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void write_bytes(const fs::path& path, const std::string& content) {
  fs::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

// `count` photos that look at one point from a row of places.
void write_model(const fs::path& folder, int count) {
  std::string cameras, images, points;
  add<std::uint64_t>(cameras, {1});
  add<std::uint32_t>(cameras, {1, 1});
  add<std::uint64_t>(cameras, {8, 6});
  add<double>(cameras, {10, 10, 4, 3});
  add<std::uint64_t>(images, {std::uint64_t(count)});
  for (int i = 0; i < count; ++i) {
    add<std::uint32_t>(images, {std::uint32_t(i + 1)});
    add<double>(images, {1, 0, 0, 0, double(i), 0, 0});
    add<std::uint32_t>(images, {1});
    images += "p " + std::to_string(i) + ".png" + '\0';
    add<std::uint64_t>(images, {1});
    add<double>(images, {4.0 + i, 3.5});  // half a pixel low
    add<std::uint64_t>(images, {1});
  }
  add<std::uint64_t>(points, {1, 1});
  add<double>(points, {0, 0, 10});
  points += "abc";
  add<double>(points, {0.5});
  add<std::uint64_t>(points, {std::uint64_t(count)});
  for (int i = 0; i < count; ++i) add<std::uint32_t>(points, {std::uint32_t(i + 1), 0});
  write_bytes(folder / "cameras.bin", cameras);
  write_bytes(folder / "images.bin", images);
  write_bytes(folder / "points3D.bin", points);
}

// A folder with photos, and the program's environment with the stand-in in front.
struct Bench {
  explicit Bench(const std::string& name) : root(scratch() / name) {
    for (int i = 0; i < 3; ++i) {
      fs::create_directories(root / "photos");
      write_png(root / "photos" / ("p " + std::to_string(i) + ".png"),
                {8, 6, 3, std::vector<std::uint8_t>(8 * 6 * 3, std::uint8_t(50 * i))});
    }
    write_model(root / "models/two", 2);
    write_model(root / "models/three", 3);
    write_bytes(root / "bin/colmap", kStandIn);
    fs::permissions(root / "bin/colmap", fs::perms::owner_all);
  }

  Words environment(const Words& more = {}) const {
    Words all = {"PATH=" + (root / "bin").string() + ":/usr/bin:/bin", "CALLS=" + (root / "calls").string(),
                 "MODELS=" + (root / "models").string()};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  Words command(const Words& more = {}) const {
    Words words = {"process", (root / "photos").string(), "-o", (root / "data").string()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  fs::path root;
};

}  // namespace

TEST_CASE("process asks COLMAP for poses on the CPU and lays out the largest model") {
  const Bench bench("process");
  const Outcome made = cloam_with(bench.command({"--json"}), bench.environment());
  CHECK_MESSAGE(made.code == 0, made.err);
  CHECK(holds(made.err, "1/3 finding features"));
  CHECK(holds(made.err, "3/3 placing cameras and points"));
  CHECK(holds(made.err, "2 groups"));
  const auto json = nlohmann::json::parse(made.out);
  CHECK(json["images_given"] == 3);
  CHECK(json["images"] == 3);
  CHECK(json["points"] == 1);
  CHECK(json["models"] == 2);
  CHECK(json["mean_error_pixels"].get<double>() == doctest::Approx(0.5));
  const std::string calls = content_of(bench.root / "calls");
  CHECK(holds(calls, "feature_extractor --database_path"));
  CHECK(holds(calls, "--SiftExtraction.use_gpu 0"));
  CHECK(holds(calls, "--ImageReader.single_camera 1"));
  CHECK(holds(calls, "exhaustive_matcher"));
  CHECK(holds(calls, "--SiftMatching.use_gpu 0"));
  CHECK(content_of(bench.root / "data/images/p 1.png") == content_of(bench.root / "photos/p 1.png"));
  const Outcome checked = cloam_with({"check", (bench.root / "data").string()});
  CHECK_MESSAGE(checked.code == 0, checked.err);
  CHECK(holds(checked.out, "format COLMAP, 1 points"));
  CHECK(holds(checked.out, "mean reprojection error 0.50 px"));

  const Outcome again = cloam_with(bench.command(), bench.environment());
  CHECK(again.code == 2);
  CHECK(holds(again.err, "--overwrite"));
  const Outcome anew = cloam_with(bench.command({"--overwrite", "--matching", "sequential"}), bench.environment());
  CHECK(anew.code == 0);
  CHECK(holds(anew.out, "3 of 3 photos placed"));
  CHECK(holds(content_of(bench.root / "calls"), "sequential_matcher"));
}

TEST_CASE("process says what went wrong") {
  const Bench bench("process-bad");
  const Outcome missing = cloam_with(bench.command(), {"PATH=/nowhere"});
  CHECK(missing.code == 2);
  CHECK(holds(missing.err, "apt-get install colmap"));
  const Outcome failed = cloam_with(bench.command(), bench.environment({"FAIL=1"}));
  CHECK(failed.code == 3);
  CHECK(holds(failed.err, "Check failed: no luck"));
  CHECK(holds(content_of(bench.root / "data/colmap/log.txt"), "Check failed: no luck"));
  const Outcome none = cloam_with(bench.command(), bench.environment({"NONE=1"}));
  CHECK(none.code == 3);
  CHECK(holds(none.err, "overlap"));
  CHECK_FALSE(fs::exists(bench.root / "data/sparse"));
  fs::remove(bench.root / "photos/p 1.png");
  CHECK(cloam_with(bench.command(), bench.environment()).code == 3);  // two photos
  CHECK(cloam_with({"process", "nowhere", "-o", "x"}, bench.environment()).code == 3);
}

TEST_CASE("process says what to do with a photo and a folder around a video") {
  const Bench bench("process-others");
  const Words to = {"-o", (bench.root / "data").string()};
  const auto refused = [&](const fs::path& given) {
    const Outcome outcome = cloam_with({"process", given.string(), to[0], to[1]}, bench.environment());
    CHECK(outcome.code == 3);
    return outcome.err;
  };
  CHECK(holds(refused(bench.root / "photos/p 1.png"), "give the folder of the photos"));
  write_bytes(bench.root / "phone/a.HEIC", "");
  write_bytes(bench.root / "phone/b.mp4", "");
  const std::string phone = refused(bench.root / "phone");
  CHECK(holds(phone, "holds 1 photos (.jpg, .jpeg, .png, .heic), want 3 or more"));
  CHECK(holds(phone, "fix: give the video: cloam process " + (bench.root / "phone/b.mp4").string()));
  fs::create_directory_symlink(bench.root / "phone", bench.root / "photos/more");
  const Outcome linked = cloam_with(bench.command(), bench.environment());
  CHECK(linked.code == 0);
  CHECK(holds(linked.err, "more is a link to a folder, which COLMAP does not follow"));
}

TEST_CASE("process ends COLMAP when it is interrupted, and goes on later") {
  const Bench bench("process-stop");
  const fs::path hangs = bench.root / "hangs";
  Process process(bench.command(), bench.environment({"HANG=" + hangs.string()}));
  REQUIRE(wait_for(hangs, process));
  process.signal(SIGINT);
  const Outcome stopped = process.wait();
  CHECK(stopped.code == 130);
  CHECK(stopped.seconds < 30);  // the stand-in would sleep for a minute
  CHECK(holds(stopped.err, "continue from there"));
  CHECK(cloam_with(bench.command(), bench.environment()).code == 0);
}

TEST_CASE("process with COLMAP itself places photos of the fox") {
  const char* given = std::getenv("CLOAM_TEST_DATA");
  const fs::path photos = fs::path(given ? given : "../shared/data") / "fox/images";
  if (!fs::exists("/usr/bin/colmap") || !fs::exists(photos)) {
    MESSAGE("skipped: no colmap, or no data");
    return;
  }
  const fs::path root = scratch() / "process-fox";
  fs::create_directories(root / "photos");
  std::vector<fs::path> names;
  for (const auto& entry : fs::directory_iterator(photos)) names.push_back(entry.path());
  std::sort(names.begin(), names.end());
  for (std::size_t i = 0; i < 8; ++i)
    write_png((root / "photos" / names[i].filename()).replace_extension(".png"), downscale(read_image(names[i]), 4));
  const Outcome made =
      cloam_with({"process", (root / "photos").string(), "-o", (root / "data").string(), "--json", "--undistort"});
  CHECK_MESSAGE(made.code == 0, made.err);
  const auto json = nlohmann::json::parse(made.out);
  CHECK(json["images"] >= 6);
  CHECK(json["points"] >= 200);
  CHECK(json["mean_error_pixels"].get<double>() < 1.5);
  CHECK(cloam_with({"check", (root / "data").string()}).code == 0);
}
