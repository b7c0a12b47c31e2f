// The table of readers, and the message for folders that none of them knows.
#include "models/data/read_scene.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <map>

#include "models/data/colmap.h"
#include "models/data/kitti.h"
#include "models/data/llff.h"
#include "models/data/near_misses.h"
#include "models/data/nuscenes.h"
#include "models/data/pandaset.h"
#include "models/data/phone_apps.h"
#include "models/data/rig.h"
#include "models/data/transforms_json.h"
#include "models/data/waymo.h"
#include "models/io/image.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

// A new format is one more row. The first that recognises the folder reads it.
constexpr SceneReader kReaders[] = {
    {"transforms.json", "transforms.json (nerfstudio, instant-ngp), transforms_train.json (NeRF-synthetic)",
     is_transforms_json, read_transforms_json},
    {"COLMAP", "sparse/0/cameras.bin, images.bin (or .txt) beside images/ (COLMAP)", is_colmap, read_colmap},
    {"LLFF", "poses_bounds.npy beside images/ (LLFF, forward-facing)", is_llff, read_llff},
    {"Polycam", "keyframes/cameras/*.json beside keyframes/images/ (Polycam)", is_polycam, read_polycam},
    {"Record3D", "EXR_RGBD/metadata.json beside EXR_RGBD/rgb/ (Record3D)", is_record3d, read_record3d},
    {"PandaSet", "camera/*_camera/poses.json, lidar/poses.json (PandaSet)", is_pandaset, read_pandaset},
    {"rig", "rig.json (your own recordings: docs/formats.md)", is_rig, read_rig},
    {"nuScenes", "v1.0-*/sample_data.json beside samples/ (nuScenes)", is_nuscenes, read_nuscenes},
    {"Waymo", "ego_pose/000.txt, extrinsics/0.txt beside images/ and lidar/ (Waymo, as DriveStudio writes it)",
     is_waymo, read_waymo},
    {"KITTI", "image_02/data, velodyne_points/data, oxts/data in a drive's folder (KITTI raw)", is_kitti, read_kitti},
};

constexpr std::size_t kMostEntries = 10000;

const SceneReader* reader_of(const fs::path& root) {
  const auto found = std::find_if(std::begin(kReaders), std::end(kReaders),
                                  [&](const SceneReader& reader) { return reader.recognises(root); });
  return found == std::end(kReaders) ? nullptr : found;
}

[[noreturn]] void refuse(const fs::path& path, const std::string& why) { bad_data(path.string(), ": ", why); }

/// Sorted. Fault::data for a folder that may not be looked into.
std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (const fs::directory_iterator end; !error && entry != end; entry.increment(error)) {
    if (found.size() < kMostEntries) found.push_back(entry->path());
  }
  if (error == std::errc::permission_denied) refuse(folder, "permission denied");
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

// transforms.JSON, rig.json.gz and the like.
std::string misnamed_manifest(const fs::path& entry) {
  const std::string name = entry.filename().string(), plain = lower_case(name);
  for (const std::string known : {"transforms.json", "transforms_train.json", "rig.json"}) {
    if (plain == known && name != known) return text("rename ", name, " to ", known);
    if (plain == known && !is_file(entry)) return text(name, " is not a regular file, or is a link to a missing one");
    if (plain.starts_with(known + ".")) return text("unpack ", name, " to ", known);
  }
  if (name == "transforms_test.json") return "add transforms_train.json, which belongs to transforms_test.json";
  return "";
}

// cameras.bin without images.bin, or the other way round.
std::string half_a_model(const fs::path& root) {
  for (const char* folder : {"sparse/0", "sparse", "."}) {
    for (const char* kind : {".bin", ".txt"}) {
      const auto path = [&](const char* stem) { return fs::path(folder) / (std::string(stem) + kind); };
      const bool cameras = is_file(root / path("cameras")), images = is_file(root / path("images"));
      if (cameras == images) continue;
      const fs::path there = path(cameras ? "cameras" : "images"), missing = path(cameras ? "images" : "cameras");
      return text("a COLMAP model needs ", missing.lexically_normal().string(), " beside ",
                  there.lexically_normal().string(), ": copy it there, or export the model again");
    }
  }
  return "";
}

bool is_photo_name(const fs::path& path) {
  return is_image_name(path) && lower_case(path.extension().string()) != ".exr";
}

std::string advice_on_files(const fs::path& root, const std::vector<fs::path>& content) {
  const auto any = [&](bool (*is_kind)(const fs::path&)) {
    return std::find_if(content.begin(), content.end(), is_kind);
  };
  const std::string poses = "photos alone need camera poses first: cloam process ";
  if (any(is_photo_name) != content.end() || any(is_heic_name) != content.end())
    return poses + quoted(root.string()) + " -o DATA";
  if (const auto video = any(is_video_name); video != content.end())
    return "a video needs camera poses first: " + process_command(*video);
  return "";
}

std::string advice(const fs::path& root, const std::vector<fs::path>& content) {
  std::error_code error;
  if (is_file(root / "run.json"))
    return text("this is a run, not data: cloam train --resume ", quoted(root.string()),
                " continues it; run.json says where its data are");
  for (const fs::path& path : content)
    if (fs::is_directory(path, error) && reader_of(path)) return "give the folder inside it: " + path.string();
  for (const fs::path& path : content)
    if (const std::string found = misnamed_manifest(path); !found.empty()) return found;
  for (const std::string& found : {half_a_model(root), advice_on_files(root, content)})
    if (!found.empty()) return found;
  for (const fs::path& path : content) {
    if (!fs::is_directory(path, error)) continue;
    if (const std::string found = advice_on_files(path, entries(path)); !found.empty()) return found;
  }
  return "give the folder that holds these files; photos alone need camera poses first: cloam process PHOTOS -o DATA";
}

[[noreturn]] void unknown(const fs::path& path) {
  std::string looked_for;
  for (const SceneReader& reader : kReaders)
    looked_for += (looked_for.empty() ? "" : "; ") + std::string(reader.looked_for);
  const auto content = entries(path);
  refuse(path, text("holds no capture that can be read.\n  looked for: ", looked_for,
                    "\n  found:      ", summary(content), "\n  fix:        ", advice(path, content)));
}

fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : fs::path("."); }

// DATA is a file.
[[noreturn]] void not_a_folder(const fs::path& path) {
  const std::string kind = lower_case(path.extension().string());
  const fs::path folder = folder_of(path);
  if (kind == ".json") refuse(path, "is a file; give its folder: " + folder.string());
  for (const char* archive : {".zip", ".tar", ".gz", ".tgz", ".xz", ".bz2", ".zst", ".7z", ".rar", ".r3d"})
    if (kind == archive) refuse(path, "is an archive; unpack it and give the folder");
  if (is_video_name(path)) refuse(path, "is a video, which needs camera poses first\n  fix: " + process_command(path));
  refuse(path, "is a file; give the folder of a capture");
}

[[noreturn]] void no_folder(const fs::path& path) {
  const fs::path clean = path.has_filename() ? path : path.parent_path();  // "data/fox/" ends in an empty name
  const fs::path parent = folder_of(clean);
  std::error_code error;
  if (!fs::is_directory(parent, error))
    bad_data("no such folder: ", path.string(), " (", parent.string(), " does not exist either)");
  bad_data("no such folder: ", path.string(), did_you_mean_path(path));
}

}  // namespace

bool is_place_of_data(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error) || (!fs::exists(path, error) && is_nuscenes(folder_of(path)));
}

Scene read_scene(const fs::path& path, const ReadOptions& options) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::status_known(status))
    refuse(path, error == std::errc::permission_denied ? "permission denied" : error.message());
  if (!fs::exists(status) && is_nuscenes(folder_of(path)))
    return read_nuscenes_scene(fs::canonical(folder_of(path)), path.filename().string(), options);
  if (!fs::exists(status)) no_folder(path);
  if (!fs::is_directory(status)) not_a_folder(path);
  const fs::path root = fs::canonical(path, error);
  if (error) refuse(path, "cannot be opened: " + error.message());
  if (::faccessat(AT_FDCWD, root.c_str(), X_OK, AT_EACCESS) != 0) refuse(path, "permission denied");
  if (const SceneReader* reader = reader_of(root)) return reader->read(root, options);
  unknown(path);
}

}  // namespace cloam
