// The table of readers, and the message for folders that none of them knows.
#include "models/data/read_scene.h"

#include <algorithm>
#include <map>

#include "models/data/colmap.h"
#include "models/data/kitti.h"
#include "models/data/pandaset.h"
#include "models/data/paths.h"
#include "models/data/rig.h"
#include "models/data/transforms_json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

// A new format is one more row. The first that recognises the folder reads it.
constexpr SceneReader kReaders[] = {
    {"transforms.json", "transforms.json (nerfstudio, instant-ngp), transforms_train.json (NeRF-synthetic)",
     is_transforms_json, read_transforms_json},
    {"COLMAP", "sparse/0/cameras.bin, images.bin (or .txt) beside images/ (COLMAP)", is_colmap, read_colmap},
    {"PandaSet", "camera/*_camera/poses.json, lidar/poses.json (PandaSet)", is_pandaset, read_pandaset},
    {"rig", "rig.json (a car of your own: docs/formats.md)", is_rig, read_rig},
    {"KITTI", "image_02/data, velodyne_points/data, oxts/data in a drive's folder (KITTI raw)", is_kitti, read_kitti},
};

constexpr std::size_t kMostEntries = 10000;

const SceneReader* reader_of(const fs::path& root) {
  const auto found = std::find_if(std::begin(kReaders), std::end(kReaders),
                                  [&](const SceneReader& reader) { return reader.recognises(root); });
  return found == std::end(kReaders) ? nullptr : found;
}

std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (found.size() < kMostEntries) found.push_back(entry->path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

// "images/, 450 .jpg, 2 .txt"
std::string summary(const std::vector<fs::path>& content) {
  std::string folders;
  std::map<std::string, int> kinds;
  std::error_code error;
  int shown = 0;
  for (const fs::path& path : content) {
    if (!fs::is_directory(path, error)) {
      ++kinds[path.has_extension() ? path.extension().string() : path.filename().string()];
    } else if (++shown <= 5) {
      folders += path.filename().string() + "/, ";
    }
  }
  std::string result = folders;
  for (const auto& [kind, count] : kinds) result += text(count, " ", kind, ", ");
  return result.empty() ? "nothing: the folder is empty"
                        : result.substr(0, std::min<std::size_t>(result.size() - 2, 300));
}

std::string advice(const std::vector<fs::path>& content) {
  for (const fs::path& path : content) {
    std::error_code error;
    if (fs::is_directory(path, error) && reader_of(path)) return "give the folder inside it: " + path.string();
  }
  return "give the folder that holds these files; photos alone need camera poses first: cloam process "
         "PHOTOS -o DATA";
}

[[noreturn]] void unknown(const fs::path& path, const std::string& found, const std::string& fix) {
  std::string looked_for;
  for (const SceneReader& reader : kReaders)
    looked_for += (looked_for.empty() ? "" : "; ") + std::string(reader.looked_for);
  throw Error(Fault::data, text(path.string(), " is not a data set that is known here.\n  looked for: ", looked_for,
                                "\n  found:      ", found, "\n  fix:        ", fix));
}

[[noreturn]] void no_folder(const fs::path& path) {
  std::error_code error;
  if (fs::exists(path, error)) {
    const bool manifest = path.extension() == ".json";
    unknown(path, "a file", manifest ? "give its folder: " + path.parent_path().string() : "give a folder");
  }
  const fs::path clean = path.has_filename() ? path : path.parent_path();  // "data/fox/" ends in an empty name
  std::vector<std::string> names;
  const fs::path parent = clean.has_parent_path() ? clean.parent_path() : fs::path(".");
  for (const fs::path& entry : entries(parent)) names.push_back(entry.filename().string());
  const std::string near = nearest_name(clean.filename().string(), names);
  unknown(path, fs::is_directory(parent, error) ? "no such folder" : "no such folder, nor the folder above it",
          near.empty() ? "check the path" : "did you mean " + (clean.parent_path() / near).string() + "?");
}

}  // namespace

Scene read_scene(const fs::path& path, const ReadOptions& options) {
  std::error_code error;
  if (!fs::is_directory(path, error)) no_folder(path);
  const fs::path root = fs::canonical(path, error);
  if (error) throw Error(Fault::data, text(path.string(), ": cannot be opened: ", error.message()));
  if (const SceneReader* reader = reader_of(root)) return reader->read(root, options);
  const auto content = entries(path);
  unknown(path, summary(content), advice(content));
}

}  // namespace cloam
