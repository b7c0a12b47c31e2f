// A disk that is full: every writer says so, and leaves neither half a file nor a temporary one; and there is no other
// way to write a file than the one that is tested here.
#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <set>

#include "models/data/data_frame.h"
#include "models/gaussians/formats.h"
#include "models/io/commit.h"
#include "models/io/gif.h"
#include "models/io/ply.h"
#include "models/io/safetensors.h"
#include "models/mesh/write_mesh.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/small_disk.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

Image noise(int channels) {
  Image image{64, 64, channels, std::vector<std::uint8_t>(std::size_t(64) * 64 * channels)};
  std::uint32_t state = 7;
  for (auto& value : image.pixels) value = static_cast<std::uint8_t>((state = state * 1664525u + 1013904223u) >> 24);
  return image;
}

Mesh triangle() { return {{0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 1, 0, 0, 1, 0, 0, 1}, std::vector<float>(9), {0, 1, 2}}; }

Gaussians gaussians() {
  constexpr std::size_t kCount = 500;
  Gaussians g{std::vector<float>(3 * kCount), std::vector<float>(3 * kCount, -3), std::vector<float>(4 * kCount, 1),
              std::vector<float>(kCount),     std::vector<float>(3 * kCount),     std::vector<float>(45 * kCount)};
  for (std::size_t i = 0; i < g.means.size(); ++i) g.means[i] = static_cast<float>(i * 7919 % 1000) / 100;
  return g;
}

using Writer = std::function<void(const fs::path&)>;

/// By file names.
std::map<std::string, Writer> writers() {
  std::map<std::string, Writer> all = {
      {"a.png", [](const fs::path& path) { write_png(path, noise(3)); }},
      {"a.jpg", [](const fs::path& path) { write_jpeg(path, noise(3)); }},
      {"a.gif",
       [](const fs::path& path) {
         write_gif(path, {noise(3), noise(3)}, 10, "how it was made");
       }},
      {"a.exr",
       [](const fs::path& path) {
         std::vector<float> values;
         for (const std::uint8_t value : noise(1).pixels) values.push_back(value);
         write_exr(path, 64, 64, {{"R", values.data()}});
       }},
      {"labels.png",
       [](const fs::path& path) {
         Labels labels{64, 64, {}};
         for (const std::uint8_t value : noise(1).pixels) labels.values.push_back(std::uint16_t(257 * value));
         write_labels(path, labels);
       }},
      {"mesh.glb",
       [](const fs::path& path) {
         write_glb(path, triangle(), {"a", {}});
       }},
      {"mesh.ply",
       [](const fs::path& path) {
         write_ply(path, triangle(), {"a", {}});
       }},
      {"points.ply",
       [](const fs::path& path) {
         write_ply_vertices(path, {{"x", std::vector<float>(5000)}});
       }},
      {"a.pkl.gz",
       [](const fs::path& path) {
         std::vector<double> values;
         for (const std::uint8_t value : noise(1).pixels) values.push_back(value / 7.0);
         DataFrame frame;
         frame.add({"x", values});
         write_data_frame(path, frame);
       }},
      {"a.safetensors",
       [](const fs::path& path) {
         SafetensorsFile file;
         file.tensors["x"] = {"U8", {9000}, std::vector<std::byte>(9000)};
         write_safetensors(path, file);
       }},
      {"a.txt", [](const fs::path& path) { commit_text(path, std::string(9000, 'x')); }},
  };
  for (const SplatFormat& format : splat_formats())
    if (format.write)
      all["splats" + std::string(format.extension)] = [&](const fs::path& path) { format.write(path, gaussians()); };
  return all;
}

/// Every writer fails with its fault, and a file that was there stays as it was.
void check_refusals(const fs::path& folder, const std::function<std::string(const std::function<void()>&)>& refused) {
  const std::size_t before = files_in(folder);
  for (const auto& [name, write] : writers()) {
    CAPTURE(name);
    const fs::path path = folder / name;
    const std::string told = refused([&] { write(path); });
    CHECK_MESSAGE(holds(told, "cannot write " + path.string()), told);
    CHECK_MESSAGE(holds(told, " bytes are free on /"), told);
    CHECK(files_in(folder) == before);
  }
}

/// The lines of code that write files by other means than commit.h, as "models/io/image.cpp ImageOutput".
std::set<std::string> other_ways() {
  const std::regex way(R"(std::(o?fstream|rename)|fopen\(|O_CREAT|O_WRONLY|ImageOutput|copy_file|create_hard_link)");
  const fs::path root = CLOAM_SOURCES;
  std::set<std::string> found;
  for (const char* part : {"cli", "models", "runtime", "benchmarks"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / part)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
      const std::string code = content_of(entry.path());
      for (std::sregex_iterator hit(code.begin(), code.end(), way), end; hit != end; ++hit)
        found.insert(fs::relative(entry.path(), root).generic_string() + " " + hit->str());
    }
  }
  return found;
}

}  // namespace

TEST_CASE("a file that may not grow: every writer tells and leaves nothing") {
  const Folder folder;
  check_refusals(folder.path, [](const std::function<void()>& write) {
    return error_of(
        [&] {
          const FileSizeLimit limit(100);
          write();
        },
        Fault::write);
  });
}

TEST_CASE("a full disk: every writer names it, leaves nothing, and replaces nothing") {
  const Folder folder;
  const FullDisk disk(folder.path / "disk", 64);
  if (!disk.mounted()) {
    MESSAGE("no rights to mount: the test of files that may not grow stands for this one");
    return;
  }
  commit_text(folder.path / "disk" / "a.png", "old");
  disk.fill();
  check_refusals(folder.path / "disk", [&](const std::function<void()>& write) {
    const std::string told = error_of(write, Fault::write);
    CHECK_MESSAGE(holds(told, "0 bytes are free on " + fs::canonical(folder.path / "disk").string() + ";"), told);
    return told;
  });
  CHECK(content_of(folder.path / "disk" / "a.png") == "old");
}

TEST_CASE("a copy that finds no room tells of it as the other writers do") {
  const Folder folder;
  std::ofstream(folder.path / "large") << std::string(9000, 'x');
  const std::string told = error_of(
      [&] {
        const FileSizeLimit limit(100);
        commit_file(folder.path / "copy", [&](const fs::path& temp) { fs::copy_file(folder.path / "large", temp); });
      },
      Fault::write);
  CHECK_MESSAGE(holds(told, "cannot write " + (folder.path / "copy").string()), told);
  CHECK_MESSAGE(holds(told, " bytes are free on /"), told);
  CHECK(files_in(folder.path) == 1);
}

TEST_CASE("a lock that finds no room is none") {
  const Folder folder;
  const std::string told = error_of(
      [&] {
        const FileSizeLimit limit(0);
        const FolderLock lock(folder.path);
      },
      Fault::write);
  CHECK_MESSAGE(holds(told, " bytes are free on /"), told);
  CHECK(files_in(folder.path) == 0);
}

TEST_CASE("what is refused for another reason says nothing of space") {
  const Folder folder;
  std::ofstream(folder.path / "file") << "x";
  const std::string told = error_of([&] { write_png(folder.path / "file" / "a.png", noise(3)); }, Fault::write);
  CHECK_MESSAGE(holds(told, (folder.path / "file").string() + " is a file: name another folder"), told);
  CHECK_FALSE(holds(told, "bytes"));
  CHECK(holds(error_of([] { commit_text("/dev/null", "x"); }, Fault::write), "/dev/null: it is a device or a pipe"));
  CHECK(fs::is_character_file("/dev/null"));
}

TEST_CASE("no other code writes files") {
  const std::set<std::string> known = {
      "benchmarks/command.cpp std::ofstream",   // cannot link models; whole or not at all by itself
      "cli/process.cpp copy_file",              // within commit_file
      "cli/process.cpp std::ofstream",          // COLMAP's log, line by line
      "cli/progress.cpp fopen(",                // metrics.jsonl, line by line
      "cli/tensorboard.cpp fopen(",             // event files, event by event
      "models/io/commit.cpp copy_file",         // the one way
      "models/io/commit.cpp create_hard_link",  // likewise
      "models/io/commit.cpp O_CREAT",           // the one way
      "models/io/commit.cpp O_WRONLY",          // likewise
      "models/io/gif.cpp ImageOutput",          // to memory
      "models/io/image.cpp ImageOutput",        // to memory
      "runtime/kernel_files.cpp O_CREAT",       // an empty file whose time alone counts
      "runtime/kernel_files.cpp O_WRONLY"};     // likewise
  for (const std::string& way : other_ways())
    CHECK_MESSAGE(known.contains(way), way, ": files are written through models/io/commit.h");
}
