// See transforms_json.h. A frame's own intrinsics win over those of the file; sizes that neither gives come from the
// header of the image.
#include "models/data/transforms_json.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "models/data/depth_map.h"
#include "models/data/near_misses.h"
#include "models/data/photos.h"
#include "models/data/poses.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/scene/point_ply.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMostPoints = 20'000'000;

// A number of the frame, else of the file.
struct Settings {
  const Json& file;
  const Json& frame;
  const std::string& where;

  std::optional<double> number(const std::string& key) const {
    const auto own = optional_number(frame, key, where);
    return own ? own : optional_number(file, key, where);
  }
  double number(const std::string& key, double otherwise) const { return number(key).value_or(otherwise); }
  std::optional<std::string> word(const std::string& key) const {
    const auto own = optional_string(frame, key, where);
    return own ? own : optional_string(file, key, where);
  }
};

// From the focal length itself, or the field of view in radians.
std::optional<double> focal_length(const Settings& settings, const std::string& axis, int size) {
  if (const auto focal = settings.number("fl_" + axis)) return focal;
  const auto angle = settings.number("camera_angle_" + axis);
  if (!angle) return {};
  if (!(*angle > 0 && *angle < std::numbers::pi))
    bad_data(settings.where, ": camera_angle_", axis, " is ", *angle, ", want radians between 0 and pi");
  return 0.5 * size / std::tan(0.5 * *angle);
}

CameraModel camera_model(const Settings& settings, const Camera& camera) {
  const bool straight = camera.k == std::array<double, 4>{} && camera.p1 == 0 && camera.p2 == 0;
  const std::string name = settings.word("camera_model").value_or("OPENCV");
  const bool fisheye = flag(settings.file, "is_fisheye", false, settings.where);
  if (name == "OPENCV_FISHEYE" || fisheye) return CameraModel::fisheye;
  const std::set<std::string> known = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"};
  if (known.contains(name)) return straight ? CameraModel::pinhole : CameraModel::opencv;
  bad_data(settings.where, ": camera_model is ", name.substr(0, 40),
           ", want PINHOLE, OPENCV or OPENCV_FISHEYE; undistort the images first");
}

/// "./images/a.jpg" is images/a.jpg.
std::string plain_path(const std::string& listed) { return fs::path(listed).lexically_normal().generic_string(); }

using Names = std::set<std::string>;

// One json file and which of its frames test.
struct Source {
  std::string name;
  Json file;
  Split split = Split::train;
  Names trains, tests, others;  // nerfstudio's lists of file names: if there is one of those that train, no other does

  Split split_of(const std::string& listed) const {
    const std::string image = plain_path(listed);
    if (tests.contains(image)) return Split::test;
    if (others.contains(image) || (!trains.empty() && !trains.contains(image))) return Split::unused;
    return split;
  }
};

/// The paths of all frames that have one.
Names frame_names(const Json& frames) {
  Names names;
  for (const Json& frame : frames) {
    if (!frame.is_object() || !frame.contains("file_path")) continue;
    if (const auto* found = frame["file_path"].get_ptr<const std::string*>()) names.insert(plain_path(*found));
  }
  return names;
}

/// Those names of a list that frames have; a warning tells of the others.
Names listed_names(const Source& source, const char* key, const Names& frames, std::vector<std::string>& warnings) {
  if (!source.file.contains(key)) return {};
  Names names;
  std::vector<std::string> unknown;
  for (const Json& image : array(source.file, key, source.name)) {
    const auto* found = image.get_ptr<const std::string*>();
    if (!found) continue;
    if (frames.contains(plain_path(*found)))
      names.insert(plain_path(*found));
    else
      unknown.push_back(printable(*found));
  }
  if (!unknown.empty())
    warnings.push_back(text(source.name, ": ", unknown.size(), " names in ", key, " are the file_path of no frame (",
                            some_of(unknown), ") and do nothing; write them as file_path has them",
                            frames.empty() ? "" : ", such as " + printable(*frames.begin())));
  return names;
}

Source read_source(const fs::path& root, const std::string& name, Split split, std::vector<std::string>& warnings) {
  Source source{name, parse_json_file(root / name), split, {}, {}, {}};
  const Names frames = frame_names(array(source.file, "frames", name));
  source.trains = listed_names(source, "train_filenames", frames, warnings);
  source.tests = listed_names(source, "test_filenames", frames, warnings);
  source.others = listed_names(source, "val_filenames", frames, warnings);
  if (source.tests.empty()) source.tests.swap(source.others);
  return source;
}

// The image as scenes name it. NeRF-synthetic lists its images without extension.
std::optional<std::string> find_image(const fs::path& root, const std::string& listed, bool allow_outside) {
  const std::string name = path_named(root, listed, allow_outside);
  for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".exr"}) {
    if (is_file(root / (name + extension))) return name + extension;
  }
  has_file(root / name);  // a folder or a device is no missing image
  return {};
}

class TransformsReader {
 public:
  TransformsReader(const fs::path& root, const ReadOptions& options) : options_(options) {
    scene_.root = root;
    scene_.format = "transforms.json";
  }

  void read(const std::string& name, Split split) {
    const Source source = read_source(scene_.root, name, split, scene_.warnings);
    const Json& frames = source.file.at("frames");
    scene_.frames_listed += frames.size();
    scene_.hints.aabb_scale = optional_number(source.file, "aabb_scale", name);
    if (const auto points = optional_string(source.file, "ply_file_path", name)) read_points(*points, name);
    scene_.has_test_split |= split == Split::test || !source.tests.empty();
    for (std::size_t i = 0; i < frames.size(); ++i) {
      guarded(options_.skip_bad, scene_.warnings, "frame dropped",
              [&] { read_frame(source, frames[i], text(name, ", frame ", i)); });
    }
  }

  Scene finish() {
    const auto unused = frames_of(scene_, Split::unused).size();
    if (unused > 0)
      scene_.warnings.push_back(text(unused, " of ", scene_.frames.size(),
                                     " images are not used: train_filenames leaves them out, or val_filenames holds ",
                                     "them back (--holdout 8 uses all)"));
    compare_exposures();
    finish_photos(scene_, missing_, options_);
    return std::move(scene_);
  }

  void expect_synthetic_bounds() { scene_.hints.synthetic_bounds = !scene_.hints.aabb_scale; }

 private:
  void read_frame(const Source& source, const Json& json, std::string where) {
    Frame frame;
    frame.name = string(json, "file_path", where);
    if (frame.name.empty())
      bad_data(where, ": file_path is empty, want the path of an image; correct or remove the frame");
    const auto image = find_image(scene_.root, frame.name,
                                  options_.allow_outside);  // before the name is shown: it checks the characters
    where += " (" + frame.name + ")";
    const Eigen::Matrix4d pose = matrix4(json, "transform_matrix", where);
    frame.world_from_camera = opencv_from_opengl_pose(rigid(pose, where));
    if (!image) {
      missing_.push_back(frame.name);
      return;
    }
    frame.image = *image;
    frame.split = source.split_of(frame.name);
    frame.timestamp = optional_number(json, "time", where);
    const Settings settings{source.file, json, where};
    frame.mask = named(settings, "mask_path", "mask");
    frame.depth = depth_map(settings);
    frame.linear = optional_flag(settings, "linear");
    const auto exposure = settings.number("exposure");
    if (exposure && !(*exposure > 0)) bad_data(where, ": exposure is ", *exposure, ", want more than 0");
    frame.exposure = exposure.value_or(0);
    frame.camera = index_of(read_camera_json(source.file, json, scene_.root / frame.image, where));
    scene_.frames.push_back(std::move(frame));
  }

  /// Of an equal camera among the scene's. By a table: each frame may have a camera of its own.
  int index_of(const Camera& camera) {
    const auto [found, is_new] = cameras_.emplace(camera, static_cast<int>(scene_.cameras.size()));
    if (is_new) scene_.cameras.push_back(camera);
    return found->second;
  }

  /// In the coordinates of the poses, as nerfstudio writes them. A capture is whole without them.
  void read_points(const std::string& listed, const std::string& where) {
    if (scene_.cloud.count() > 0) return;
    const fs::path file = scene_.root / path_named(scene_.root, listed, options_.allow_outside);
    if (!has_file(file)) {
      scene_.warnings.push_back(
          text(where, ": ply_file_path names ", listed, ", which is missing: splat starts from random points"));
      return;
    }
    std::uint64_t given = 0;
    guarded(options_.skip_bad, scene_.warnings, "points dropped", [&] {
      without_quotes(file, [&] {
        read_ply(file, [&](const PlyHeader& header) {
          given = header.count;
          if (given > kMostPoints) bad_data(file.string(), ": ", given, " points, want ", kMostPoints, " or fewer");
          return point_rows(header, scene_.cloud);
        });
      });
    });
    if (scene_.cloud.count() < given)
      scene_.warnings.push_back(text(given - scene_.cloud.count(), " of ", given, " points of ", listed,
                                     " are left out: their positions are not finite"));
  }

  static std::optional<bool> optional_flag(const Settings& settings, const std::string& key) {
    if (settings.frame.contains(key)) return flag(settings.frame, key, false, settings.where);
    if (settings.file.contains(key)) return flag(settings.file, key, false, settings.where);
    return std::nullopt;
  }

  /// As multiples of the middle one; photos that say nothing are as bright as that.
  void compare_exposures() {
    std::vector<double> known;
    for (const Frame& frame : scene_.frames)
      if (frame.exposure > 0) known.push_back(frame.exposure);
    const auto middle = known.begin() + std::ptrdiff_t(known.size() / 2);
    if (!known.empty()) std::nth_element(known.begin(), middle, known.end());
    for (Frame& frame : scene_.frames) frame.exposure = frame.exposure > 0 ? frame.exposure / *middle : 1;
  }

  /// A file that the frame names, if it does.
  std::optional<std::string> named(const Settings& settings, const std::string& key, const char* what) {
    const auto listed = optional_string(settings.frame, key, settings.where);
    if (!listed) return std::nullopt;
    const std::string file = path_named(scene_.root, *listed, options_.allow_outside);
    if (!has_file(scene_.root / file))
      bad_data(settings.where, ": the ", what, " ", file, " is missing; copy it to there, or remove ", key,
               " from the list");
    return file;
  }

  /// As nerfstudio names it, with the factor that it takes as a setting of its reader.
  std::optional<DepthMap> depth_map(const Settings& settings) {
    const auto file = named(settings, "depth_file_path", "depth map");
    if (!file) return std::nullopt;
    DepthMap depth{*file, named(settings, "confidence_file_path", "map of confidence")};
    depth.unit = settings.number("depth_unit_scale_factor", usual_depth_unit(depth.file));
    if (!(depth.unit > 0)) bad_data(settings.where, ": depth_unit_scale_factor is ", depth.unit, ", want more than 0");
    depth.along_ray = flag(settings.file, "is_euclidean_depth", false, settings.where);
    return depth;
  }

  ReadOptions options_;
  Scene scene_;
  std::vector<std::string> missing_;
  std::map<Camera, int> cameras_;  // places in the scene's
};

}  // namespace

Camera read_camera_json(const Json& file, const Json& frame, const fs::path& image, const std::string& where) {
  const Settings settings{file, frame, where};
  Camera camera;
  const auto w = settings.number("w"), h = settings.number("h");
  const ImageSize size = w && h ? ImageSize{} : read_image_size(image);
  camera.width = w ? image_side(*w, "w", settings.where) : size.width;
  camera.height = h ? image_side(*h, "h", settings.where) : size.height;
  const auto fx = focal_length(settings, "x", camera.width), fy = focal_length(settings, "y", camera.height);
  if (!fx && !fy)
    bad_data(settings.where,
             ": no focal length: looked for fl_x, fl_y, camera_angle_x and "
             "camera_angle_y in the frame and in the file");
  camera.fx = fx ? *fx : *fy;
  camera.fy = fy ? *fy : *fx;
  camera.cx = settings.number("cx", 0.5 * camera.width);
  camera.cy = settings.number("cy", 0.5 * camera.height);
  for (int i = 0; i < 4; ++i) camera.k[i] = settings.number("k" + std::to_string(i + 1), 0);
  camera.p1 = settings.number("p1", 0);
  camera.p2 = settings.number("p2", 0);
  camera.model = camera_model(settings, camera);
  require_sound(camera, settings.where);
  return camera;
}

bool is_transforms_json(const fs::path& root) {
  return is_file(root / "transforms.json") || is_file(root / "transforms_train.json");
}

Scene read_transforms_json(const fs::path& root, const ReadOptions& options) {
  TransformsReader reader(root, options);
  if (!is_file(root / "transforms_train.json")) {
    reader.read("transforms.json", Split::train);
    return reader.finish();
  }
  // The benchmark's validation views stand in for test views only where those were left out.
  for (const char* name : {"transforms_test.json", "transforms_val.json"}) {
    if (!is_file(root / name)) continue;
    reader.read(name, Split::test);
    break;
  }
  reader.read("transforms_train.json", Split::train);
  reader.expect_synthetic_bounds();
  return reader.finish();
}

}  // namespace cloam
