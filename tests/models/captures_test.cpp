// Several captures read at once: what comes back is what reading them one by one gives.
#include "models/runs/captures.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

#include "models/io/image.h"
#include "models/io/in_parallel.h"
#include "models/synth/synthetic_scene.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// Folders of small captures that differ.
std::vector<fs::path> small_captures(const fs::path& root, int count) {
  std::vector<fs::path> folders;
  for (int i = 0; i < count; ++i) {
    folders.push_back(root / std::to_string(i));
    write_synthetic_scene(folders.back(), {.train = 3 + i, .test = 2, .size = 16, .seed = static_cast<uint64_t>(i)});
  }
  return folders;
}

std::shared_ptr<HostStore> roomy() { return std::make_shared<HostStore>(1 << 30, 0); }

std::string error_of_reading(const std::vector<fs::path>& data) {
  try {
    read_captures(data, {}, {roomy()}, [](auto&&...) {});
  } catch (const Error& error) { return error.what(); }
  return "";
}

}  // namespace

TEST_CASE("pieces of parallel work are done once each; of several failures the first piece's is told") {
  std::vector<std::atomic<int>> done(1000);
  in_parallel(done.size(), [&](std::size_t i) { ++done[i]; });
  CHECK(std::all_of(done.begin(), done.end(), [](const auto& times) { return times == 1; }));
  in_parallel(0, [](std::size_t) { FAIL("nothing is to be done"); });
  const auto pause = [](int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); };
  for (const std::size_t late : {20U, 21U}) {  // the first failure comes after another, or before it
    std::atomic<bool> other = false;
    std::string told;
    try {
      in_parallel(64, [&](std::size_t i) {
        if (i == 21) other = true;
        for (int wait = 0; i == 20 && wait < 100 && !other; ++wait) pause(1);  // for ever where there is one core
        if (i == late) pause(20);
        if (i >= 20) throw Error(Fault::data, text(i));
      });
    } catch (const Error& error) { told = error.what(); }
    CHECK(told == "20");
  }
}

TEST_CASE("captures that are read at once are those that are read one by one, in their order") {
  const Folder folder;
  const std::vector<fs::path> data = small_captures(folder.path, 5);
  std::vector<std::string> told;
  const Captures together =
      read_captures(data, {}, {roomy()}, [&](const std::string& what, std::size_t done, std::size_t all) {
        told.push_back(text(what, " ", done, "/", all));
      });
  CHECK(told == std::vector<std::string>{"listed 1/5", "listed 2/5", "listed 3/5", "listed 4/5", "listed 5/5",
                                         "read 1/5", "read 2/5", "read 3/5", "read 4/5", "read 5/5", "decoded 1/5",
                                         "decoded 2/5", "decoded 3/5", "decoded 4/5", "decoded 5/5"});
  REQUIRE(together.size() == data.size());
  for (std::size_t i = 0; i < data.size(); ++i) {
    const Capture alone = std::move(read_captures({data[i]}, {}, {roomy()}, [](auto&&...) {}).front());
    CHECK(together[i].scene.root == alone.scene.root);
    CHECK(fingerprint(together[i].scene) == fingerprint(alone.scene));
    CHECK(together[i].warnings == alone.warnings);
    REQUIRE(together[i].train.size() == 3 + i);
    for (std::size_t f = 0; f < alone.train.size(); ++f) CHECK(together[i].train[f]->rgba == alone.train[f]->rgba);
    CHECK(together[i].test.size() == 2);
  }
}

TEST_CASE("masks that keep no pixel of any photo are refused, with the values that they have") {
  const Folder folder;
  const std::vector<fs::path> data = small_captures(folder.path, 1);
  const auto mask = [&](int photo, std::uint8_t value) {
    fs::create_directories(data[0] / "masks/train");
    write_png(data[0] / text("masks/train/r_", photo, ".png"), {16, 16, 1, std::vector<std::uint8_t>(256, value)});
  };
  const auto refused = [&](MaskMeaning masks) {
    return error_of(
        [&] { read_captures(data, {.masks = masks}, {std::make_shared<HostStore>(0, 0)}, [](auto&&...) {}); });
  };
  for (const MaskMeaning meaning : {MaskMeaning::ignore, MaskMeaning::transparent}) {
    for (int photo = 0; photo < 3; ++photo) mask(photo, 1);
    CHECK(holds(refused(meaning), "the largest value of masks/train/r_0.png is 1, want 255"));
    for (int photo = 0; photo < 3; ++photo) mask(photo, 0);
    CHECK(holds(refused(meaning), "is 0, want 255"));
    mask(2, 255);
    CHECK(refused(meaning) == "no error");
  }
}

TEST_CASE("of several captures that are wrong the first is told, whichever is met first") {
  const Folder folder;
  const std::vector<fs::path> data = small_captures(folder.path, 4);
  const auto cut_photo = [&](int capture) {
    const Captures sound = read_captures({data[static_cast<std::size_t>(capture)]}, {}, {roomy()}, [](auto&&...) {});
    const Scene& scene = sound.front().scene;
    const fs::path photo = scene.root / scene.frames.back().image;
    fs::resize_file(photo, fs::file_size(photo) / 2);
  };
  cut_photo(3);
  CHECK(error_of_reading(data).find("/3/") != std::string::npos);
  cut_photo(1);
  for (int repeat = 0; repeat < 10; ++repeat) CHECK(error_of_reading(data).find("/1/") != std::string::npos);
  fs::remove_all(data[0]);
  CHECK(error_of_reading(data).find("no such folder: " + data[0].string()) != std::string::npos);
}
