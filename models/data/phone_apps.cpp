// See phone_apps.h.
#include "models/data/phone_apps.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "models/data/depth_map.h"
#include "models/data/photos.h"
#include "models/data/poses.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kFarFromMiddle = 0.1;  // of a side

Scene begin_scene(const fs::path& root, const char* format) {
  Scene scene;
  scene.root = root;
  scene.format = format;
  scene.up = Eigen::Vector3d::UnitY();
  scene.metric = true;
  return scene;
}

/// FOLDER/STEM.jpg or the like, as scenes name it; STEM.jpg if there is none.
std::string image_beside(const fs::path& root, const fs::path& folder, const std::string& stem) {
  for (const char* extension : {".jpg", ".jpeg", ".png"})
    if (is_file(root / folder / (stem + extension))) return (folder / (stem + extension)).generic_string();
  return (folder / (stem + ".jpg")).generic_string();
}

/// FOLDER/NAME as scenes name it, if it is there.
std::optional<std::string> file_in(const fs::path& root, const fs::path& folder, const std::string& name) {
  if (!has_file(root / folder / name)) return std::nullopt;
  return (folder / name).generic_string();
}

std::optional<DepthMap> depth_in(const fs::path& root, const fs::path& folder, const std::string& name) {
  const auto file = file_in(root, folder, name);
  if (!file) return std::nullopt;
  return DepthMap{*file, std::nullopt, usual_depth_unit(*file)};
}

/// Adds the frame, or its name to those that are missing. pose: as ARKit has it.
void add_frame(Scene& scene, Frame frame, const Camera& camera, const Eigen::Matrix4d& pose,
               std::vector<std::string>& missing) {
  ++scene.frames_listed;
  if (!is_file(scene.root / frame.image)) {
    missing.push_back(frame.image);
    return;
  }
  frame.name = frame.image;
  frame.camera = find_or_add(scene.cameras, camera);
  frame.world_from_camera = opencv_from_opengl_pose(pose);
  scene.frames.push_back(std::move(frame));
}

struct PolycamFolders {
  fs::path cameras = "keyframes/corrected_cameras", images = "keyframes/corrected_images";
};

PolycamFolders polycam_folders(const fs::path& root) {
  std::error_code error;
  const PolycamFolders corrected;
  if (fs::is_directory(root / corrected.cameras, error) && fs::is_directory(root / corrected.images, error))
    return corrected;
  return {"keyframes/cameras", "keyframes/images"};
}

Camera polycam_camera(const Json& json, const std::string& where) {
  Camera camera;
  camera.width = image_side(number(json, "width", where), "width", where);
  camera.height = image_side(number(json, "height", where), "height", where);
  camera.fx = number(json, "fx", where);
  camera.fy = number(json, "fy", where);
  camera.cx = number(json, "cx", where);
  camera.cy = number(json, "cy", where);
  require_sound(camera, where);
  return camera;
}

Eigen::Matrix4d polycam_pose(const Json& json, const std::string& where) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) pose(row, column) = number(json, text("t_", row, column), where);
  return rigid(pose, where);
}

fs::path record3d_folder(const fs::path& root) { return is_file(root / "EXR_RGBD/metadata.json") ? "EXR_RGBD" : ""; }

/// `count` numbers of an array, or one that is missing in words.
std::vector<double> numbers(const Json& list, std::size_t count, const std::string& where) {
  std::vector<double> values;
  if (list.is_array())
    for (const Json& value : list) values.push_back(value.is_number() ? value.get<double>() : NAN);
  bool finite = values.size() == count;
  for (const double value : values) finite = finite && std::isfinite(value);
  if (!finite) bad_data(where, ": want ", count, " finite numbers");
  return values;
}

/// Position and rotation of a camera: x y z w of a quaternion, then the place.
Eigen::Matrix4d record3d_pose(const Json& json, const std::string& where) {
  const std::vector<double> value = numbers(json, 7, where);
  const Eigen::Quaterniond turn(value[3], value[0], value[1], value[2]);
  if (std::abs(turn.norm() - 1) > 0.01) bad_data(where, ": the quaternion has the length ", turn.norm(), ", want 1");
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() = turn.normalized().toRotationMatrix();
  pose.topRightCorner<3, 1>() = Eigen::Vector3d(value[4], value[5], value[6]);
  return rigid(pose, where);
}

/// The intrinsics of photo i: its own, or those of all (K, column by column).
Camera record3d_camera(const Json& json, std::size_t i, const std::string& where) {
  Camera camera;
  camera.width = image_side(number(json, "w", where), "w", where);
  camera.height = image_side(number(json, "h", where), "h", where);
  const auto own = json.find("perFrameIntrinsicCoeffs");
  if (own != json.end() && own->is_array() && i < own->size()) {
    const std::vector<double> value = numbers((*own)[i], 4, text(where, ", perFrameIntrinsicCoeffs ", i));
    camera.fx = value[0], camera.fy = value[1], camera.cx = value[2], camera.cy = value[3];
  } else {
    const std::vector<double> value = numbers(array(json, "K", where), 9, where + ", K");
    camera.fx = value[0], camera.fy = value[4], camera.cx = value[6], camera.cy = value[7];
  }
  // Some exports count it in another image's pixels.
  const auto far = [](double middle, int side) { return std::abs(middle / side - 0.5) > kFarFromMiddle; };
  if (far(camera.cx, camera.width) || far(camera.cy, camera.height)) {
    camera.cx = 0.5 * camera.width;
    camera.cy = 0.5 * camera.height;
  }
  require_sound(camera, where);
  return camera;
}

/// Poses belong to photos by number: what one list has more than another is told.
void compare_counts(Scene& scene, const Json& json, const fs::path& folder, std::size_t poses) {
  const std::vector<fs::path> files = entries_of(scene.root / folder / "rgb");
  const auto photos = static_cast<std::size_t>(std::count_if(files.begin(), files.end(), is_image_name));
  const std::string name = (folder / "metadata.json").generic_string();
  if (photos > poses)
    scene.warnings.push_back(text(name, " has ", poses, " poses, ", (folder / "rgb").generic_string(), "/ has ", photos,
                                  " photos: those without a pose are not used"));
  const auto own = json.find("perFrameIntrinsicCoeffs");
  if (own != json.end() && own->is_array() && own->size() != poses)
    scene.warnings.push_back(text(name, " has ", poses, " poses and perFrameIntrinsicCoeffs of ", own->size(),
                                  " photos: the others have those of K"));
}

}  // namespace

bool is_polycam(const fs::path& root) {
  std::error_code error;
  const PolycamFolders folders = polycam_folders(root);
  return fs::is_directory(root / folders.cameras, error) && fs::is_directory(root / folders.images, error);
}

Scene read_polycam(const fs::path& root, const ReadOptions& options) {
  Scene scene = begin_scene(root, "Polycam");
  const PolycamFolders folders = polycam_folders(root);
  std::vector<std::string> missing;
  for (const fs::path& file : entries_of(root / folders.cameras)) {
    if (file.extension() != ".json") continue;
    const std::string where = (folders.cameras / file.filename()).generic_string();
    guarded(options.skip_bad, scene.warnings, "frame dropped", [&] {
      const Json json = parse_json_file(file);
      const std::string stem = file.stem().string();
      Frame frame;
      frame.image = image_beside(root, folders.images, stem);
      frame.depth = depth_in(root, "keyframes/depth", stem + ".png");
      if (frame.depth) frame.depth->confidence = file_in(root, "keyframes/confidence", stem + ".png");
      add_frame(scene, std::move(frame), polycam_camera(json, where), polycam_pose(json, where), missing);
    });
  }
  finish_photos(scene, missing, options);
  return scene;
}

bool is_record3d(const fs::path& root) {
  std::error_code error;
  const fs::path folder = root / record3d_folder(root);
  return is_file(folder / "metadata.json") && fs::is_directory(folder / "rgb", error);
}

Scene read_record3d(const fs::path& root, const ReadOptions& options) {
  Scene scene = begin_scene(root, "Record3D");
  const fs::path folder = record3d_folder(root);
  const std::string name = (folder / "metadata.json").generic_string();
  const Json json = parse_json_file(root / name);
  const Json& poses = array(json, "poses", name);
  std::vector<std::string> missing;
  compare_counts(scene, json, folder, poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i)
    guarded(options.skip_bad, scene.warnings, "frame dropped", [&] {
      const std::string stem = std::to_string(i);
      Frame frame;
      frame.image = image_beside(root, folder / "rgb", stem);
      frame.depth = depth_in(root, folder / "depth", stem + ".exr");
      add_frame(scene, std::move(frame), record3d_camera(json, i, name),
                record3d_pose(poses[i], text(name, ", pose ", i)), missing);
    });
  finish_photos(scene, missing, options);
  scene.up = mean_up(scene);
  return scene;
}

}  // namespace cloam
