// See write_transforms.h.
#include "models/data/write_transforms.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "models/data/poses.h"
#include "models/io/commit.h"
#include "models/scene/point_ply.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Ordered = nlohmann::ordered_json;

std::string model_name(const Camera& camera) {
  if (camera.model == CameraModel::fov || camera.denominator != decltype(camera.denominator){} ||
      camera.prism != decltype(camera.prism){})
    throw Error(
        Fault::usage,
        "transforms.json has no words for this lens (FOV, or terms beyond k4 and p2)\n  fix: undistort the photos "
        "with `colmap image_undistorter` and train on those");
  if (camera.model == CameraModel::fisheye) return "OPENCV_FISHEYE";
  return camera.model == CameraModel::pinhole ? "PINHOLE" : "OPENCV";
}

void put_camera(const Camera& camera, Ordered& to) {
  to["camera_model"] = model_name(camera);
  to["w"] = camera.width, to["h"] = camera.height;
  to["fl_x"] = camera.fx, to["fl_y"] = camera.fy, to["cx"] = camera.cx, to["cy"] = camera.cy;
  for (size_t i = 0; i < camera.k.size(); ++i)
    if (camera.k[i] != 0) to["k" + std::to_string(i + 1)] = camera.k[i];
  if (camera.p1 != 0) to["p1"] = camera.p1;
  if (camera.p2 != 0) to["p2"] = camera.p2;
}

/// A file of the capture once more, under its own name, or where that leads outside, under `inside`.
std::string copied(const fs::path& folder, const fs::path& root, const std::string& name, const std::string& inside) {
  const fs::path plain = fs::path(name).lexically_normal();
  const bool outside = plain.is_absolute() || (!plain.empty() && *plain.begin() == "..");
  const fs::path to = outside ? fs::path("outside") / (inside + plain.extension().string()) : plain;
  commit_link(root / name, folder / to);
  return to.generic_string();
}

Ordered rows_of(const Eigen::Matrix4d& matrix) {
  Ordered rows = Ordered::array();
  for (int row = 0; row < 4; ++row) rows.push_back({matrix(row, 0), matrix(row, 1), matrix(row, 2), matrix(row, 3)});
  return rows;
}

Ordered frame_of(const fs::path& folder, const Scene& scene, std::size_t index) {
  const Frame& frame = scene.frames[index];
  const auto put = [&](const std::string& file, const std::string& kind) {
    return copied(folder, scene.root, file, std::to_string(index) + kind);
  };
  Ordered out = {{"file_path", put(frame.image, "")}};
  if (frame.mask) out["mask_path"] = put(*frame.mask, "_mask");
  if (frame.depth) {
    out["depth_file_path"] = put(frame.depth->file, "_depth");
    out["depth_unit_scale_factor"] = frame.depth->unit;
    if (frame.depth->confidence) out["confidence_file_path"] = put(*frame.depth->confidence, "_confidence");
  }
  const bool differs =
      std::any_of(scene.frames.begin(), scene.frames.end(), [](const Frame& other) { return other.exposure != 1; });
  if (frame.linear) out["linear"] = *frame.linear;
  if (differs) out["exposure"] = frame.exposure;
  if (frame.timestamp) out["time"] = *frame.timestamp;
  // Two axes change their signs, which is its own inverse.
  out["transform_matrix"] = rows_of(opencv_from_opengl_pose(frame.world_from_camera));
  if (scene.cameras.size() > 1) put_camera(scene.cameras[static_cast<std::size_t>(frame.camera)], out);
  return out;
}

}  // namespace

void write_transforms(const fs::path& folder, const Scene& scene) {
  Ordered train = Ordered::object(), test;
  if (scene.cameras.size() == 1) put_camera(scene.cameras.front(), train);
  for (const Camera& camera : scene.cameras) model_name(camera);  // before anything is written
  if (scene.hints.aabb_scale) train["aabb_scale"] = *scene.hints.aabb_scale;
  const auto along_ray = [](const Frame& frame) { return frame.depth && frame.depth->along_ray; };
  if (std::any_of(scene.frames.begin(), scene.frames.end(), along_ray)) train["is_euclidean_depth"] = true;
  test = train;
  train["frames"] = test["frames"] = Ordered::array();
  const bool apart = scene.hints.synthetic_bounds;
  Ordered names = Ordered::array(), trains = Ordered::array();
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    const bool tests = scene.has_test_split && scene.frames[i].split == Split::test;
    const Ordered frame = frame_of(folder, scene, i);
    if (tests) names.push_back(frame["file_path"]);
    if (scene.frames[i].split == Split::train) trains.push_back(frame["file_path"]);
    (tests && apart ? test : train)["frames"].push_back(frame);
  }
  if (!names.empty() && !apart) train["test_filenames"] = names;
  if (!frames_of(scene, Split::unused).empty()) train["train_filenames"] = trains;
  if (scene.cloud.count() > 0) {
    train["ply_file_path"] = "points.ply";
    write_point_ply(folder / "points.ply", scene.cloud);
  }
  if (!apart) return commit_text(folder / "transforms.json", train.dump(1) + "\n");
  if (!names.empty()) commit_text(folder / "transforms_test.json", test.dump(1) + "\n");
  commit_text(folder / "transforms_train.json", train.dump(1) + "\n");
}

}  // namespace cloam
