// The one description of a capture that all readers fill and all methods take. Images stay on disk until
// models/data/load_images.h reads them, LiDAR points until models/data/load_sweep.h does. Photos have frames alone;
// driving logs have sweeps and actors too, and count their moments in steps: what has one step belongs together.
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "models/scene/camera.h"
#include "models/scene/point_cloud.h"
#include "models/scene/recording.h"

namespace cloam {

/// What black pixels of masks mean: they take no part in training and figures, or they are empty background.
enum class MaskMeaning { ignore, transparent };

/// How far away what a photo shows is, pixel by pixel, in a file beside it.
struct DepthMap {
  std::string file;                       // relative to the root
  std::optional<std::string> confidence;  // the same; how sure the sensor was, 0 to 255
  double unit = 1;                        // scene units that 1 in the file stands for
  bool along_ray = false;                 // distances from the camera's centre; false: along its optical axis
  bool operator==(const DepthMap&) const = default;
};

enum class Split { train, test, unused };  // unused: a protocol leaves it out

struct Frame {
  std::string name;                 // the image path as listed; unique in a sound capture
  std::string image;                // an existing file, relative to the root
  std::optional<std::string> mask;  // relative to the root; what black means is MaskMeaning
  std::optional<DepthMap> depth;
  std::optional<bool> linear;       // the image's numbers are proportional to light; none: they are in an EXR
  double exposure = 1;              // how much light the image took in, relative to others of the capture
  std::optional<double> timestamp;  // seconds
  // Right-handed; camera axes x right, y down, z forward; a rotation and a position in scene units.
  Eigen::Matrix4d world_from_camera = Eigen::Matrix4d::Identity();
  int camera = 0;  // index into Scene::cameras
  Split split = Split::train;
  std::string sensor;  // in logs the camera's name, "front_camera"
  int step = 0;
  double ego_rows = 0;  // share of the image's height, at its bottom, that shows the recording car: ignored

  /// The camera's centre in the world.
  Eigen::Vector3d position() const { return world_from_camera.topRightCorner<3, 1>(); }
};

/// What the LiDARs of a log saw about one moment.
struct Sweep {
  std::string file;      // relative to the root
  double timestamp = 0;  // seconds
  Eigen::Matrix4d world_from_lidar = Eigen::Matrix4d::Identity();
  int step = 0;
  Split split = Split::train;
  bool points_in_world = true;  // what the file holds; false: in the LiDAR's own frame
  // None: all returns count as seen at `timestamp`. Else each was seen at its own time, while the LiDAR moved on:
  std::optional<Eigen::Vector3d> velocity = {};      // metres a second, in the world
  std::optional<Eigen::Vector3d> second_lidar = {};  // place of sensor 1 in the axes of sensor 0; none: not known
};

/// Where a LiDAR was when it saw a return, and when that was.
struct SeenFrom {
  Eigen::Vector3d origin;  // in the world
  double time = 0;         // seconds, of a grid of 5 ms about the sweep's: what moves is placed once for many returns
};

/// sensor and seconds_after: as LidarPoints has them for the return.
SeenFrom seen_from(const Sweep& sweep, int sensor, double seconds_after);

/// Where an actor is at one step. Axes of the box: x right, y forward, z up; the origin is its centre.
struct ActorBox {
  int step = 0;
  double timestamp = 0;  // seconds
  Eigen::Matrix4d world_from_box = Eigen::Matrix4d::Identity();
};

/// The looks of an actor of a run: shape and colour without a place.
struct AssetName {
  int scene = 0;         // index into the run's scenes
  std::string actor_id;  // unique there
  bool operator==(const AssetName&) const = default;
};

/// A thing with a box of its own: vehicle, pedestrian, sign.
struct Actor {
  std::string id;                                  // unique in the log
  std::string label;                               // the source's word: "Car", "Pedestrian"
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  // metres, along the box's axes
  bool stationary = false;
  std::vector<ActorBox> boxes;          // by step, at most one each
  std::optional<AssetName> asset = {};  // in an edited scene: whose looks it has; none: its own
  bool follows_path = false;            // in an edited scene: no learned correction moves its boxes
};

/// What the source says about where the subject is.
struct SceneHints {
  std::optional<double>
      aabb_scale;                 // instant-ngp: the subject and surroundings lie in a cube of side aabb_scale / 0.33
  bool synthetic_bounds = false;  // NeRF-synthetic: the object lies in [-1.5, 1.5]^3, cameras about 4 away
  std::optional<double> nearest = {};  // forward-facing: how far along its axis the first thing is that a photo sees
};

struct Scene {
  std::filesystem::path root;
  std::string part;                               // of a root that holds several logs, this one's name
  std::string format;                             // the reader's name
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // in the world frame
  bool metric = false;                            // true: one unit is one metre; false: the scale is unknown
  bool has_alpha = false;                         // images have an alpha channel: the background is empty
  bool has_test_split = false;                    // the source gives its own test images
  SceneHints hints;
  std::vector<Camera> cameras;        // distinct intrinsics only
  std::vector<Frame> frames;          // images that exist, in the order listed
  std::size_t frames_listed = 0;      // including those that were skipped
  std::vector<Sweep> sweeps;          // by step
  std::vector<Actor> actors;          // by id
  std::size_t other_actors = 0;       // that were left to the background (keep_road_users)
  PointCloud cloud;                   // empty where the source has none
  bool is_log = false;                // frames, sweeps and actors have steps
  bool night = false;                 // of a log
  Recording recording;                // of a log
  std::vector<std::string> warnings;  // one line each, for the user

  /// What read_scene was given, made absolute.
  std::filesystem::path place() const { return part.empty() ? root : root / part; }
};

/// What a run is trained on: one capture, or several logs.
using Scenes = std::vector<Scene>;

/// The actor's pose at a time between two of its boxes (positions linear, rotations spherical). Also up to half a usual
/// distance of boxes before its first and after its last, where the nearest box stands; none elsewhere, or where boxes
/// are missing for more than 1.5 of these distances.
std::optional<Eigen::Matrix4d> world_from_box_at(const Actor& actor, double time);

/// Whether any of the actor's boxes lies more than a metre (in the log's axes) from where its first one does. What the
/// source says of it (`stationary`) is not asked: not every format has it, and a parked car may drive off.
bool goes_somewhere(const Actor& actor);

/// The actor's box at a step; null where it has none.
const ActorBox* box_at_step(const Actor& actor, int step);

/// Where an actor with a box at `step` is at `time`: as world_from_box_at has it, else (no time, or too far from its
/// boxes) where the box of that step is. None for an actor without a box at that step.
std::optional<Eigen::Matrix4d> world_from_box_of_step(const Actor& actor, int step, std::optional<double> time);

/// The indices of the frames of one split, in order.
std::vector<std::size_t> frames_of(const Scene& scene, Split split);

/// The mean of the cameras' up (-y), of length 1; scene.up where they look from all sides and so have none in common.
Eigen::Vector3d mean_up(const Scene& scene);

/// The index of an equal camera, added if it is new.
int find_or_add(std::vector<Camera>& cameras, const Camera& camera);

}  // namespace cloam
