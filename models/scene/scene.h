// The one description of a capture that all readers fill and all methods take. Images stay on disk until
// models/data/load_images.h reads them.
//
// Room that driving logs will take, as further members beside `frames` (readers of photos leave them empty):
//   sweeps  LiDAR sweeps: points [N,3] in metres in the world frame, intensities, times, sensor pose
//   actors  boxes with a track each: world_from_box per time stamp, size in metres, class name
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "models/scene/camera.h"

namespace cloam {

enum class Split { train, test };

struct Frame {
  std::string name;                 // the image path as listed; unique in a sound capture
  std::string image;                // an existing file, relative to the root
  std::optional<std::string> mask;  // relative to the root; black pixels are ignored
  std::optional<double> timestamp;  // seconds
  // Right-handed; camera axes x right, y down, z forward; a rotation and a position in scene units.
  Eigen::Matrix4d world_from_camera = Eigen::Matrix4d::Identity();
  int camera = 0;  // index into Scene::cameras
  Split split = Split::train;
};

/// What the source says about where the subject is.
struct SceneHints {
  std::optional<double>
      aabb_scale;                 // instant-ngp: the subject and surroundings lie in a cube of side aabb_scale / 0.33
  bool synthetic_bounds = false;  // NeRF-synthetic: the object lies in [-1.5, 1.5]^3, cameras about 4 away
};

struct Scene {
  std::filesystem::path root;
  std::string format;                             // the reader's name
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // in the world frame
  bool metric = false;                            // true: one unit is one metre; false: the scale is unknown
  bool has_alpha = false;                         // images have an alpha channel: the background is empty
  bool has_test_split = false;                    // the source gives its own test images
  SceneHints hints;
  std::vector<Camera> cameras;        // distinct intrinsics only
  std::vector<Frame> frames;          // images that exist, in the order listed
  std::size_t frames_listed = 0;      // including those that were skipped
  std::vector<std::string> warnings;  // one line each, for the user
};

/// The indices of the frames of one split, in order.
std::vector<std::size_t> frames_of(const Scene& scene, Split split);

/// Sorts the frames by name and makes every nth of them, from the first on, the test split; all others train.
/// A split that the source gave is forgotten. Fault::usage for n < 2, which would leave nothing to train on.
void apply_holdout(Scene& scene, int n);

/// The index of an equal camera, added if it is new.
int find_or_add(std::vector<Camera>& cameras, const Camera& camera);

}  // namespace cloam
