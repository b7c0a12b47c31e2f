// What a driving log gives a training step: patches of its images and returns of its LiDAR, as rays in axes of the log.
#pragma once
#include <optional>

#include "models/io/host_random.h"
#include "models/io/share.h"
#include "models/scene/camera_motion.h"
#include "models/scene/lidar_points.h"
#include "models/scene/photo_store.h"
#include "models/scene/resting_scene.h"
#include "runtime/tensor.h"

namespace cloam {

/// Rays side by side. A moment is a time that several of them share.
struct RayList {
  std::vector<float> origins, directions;  // [R,3], axes of the log, metres; directions of length 1
  std::vector<int32_t> moments;            // [R]
  std::vector<float> ranges;               // [R] metres to what a LiDAR saw; 0: a camera's ray, or nothing came back
  std::vector<float> intensities;          // [R] of what a LiDAR saw, 0 to 1
  std::vector<double> times;               // of the moments, seconds
  std::vector<bool> actors;                // which of Scene::actors the rays may meet; empty: all
  int64_t count() const { return static_cast<int64_t>(moments.size()); }
  /// At the last moment.
  void add(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, float range = 0);
  /// The last ray is of the moment with this time among those from `first` on, which is new if there is none.
  void last_is_at(double time, std::size_t first);
};

/// Rays [begin, end) with the moments between the first and the last of theirs.
RayList part_of(const RayList& rays, int64_t begin, int64_t end);

/// A part of an image, in cells of some pixels a side.
struct Region {
  int64_t x, y, columns, rows;
};
/// All of an image, cut cells too.
Region cells_of(const Camera& camera, int scale);

/// A camera that exposes an image.
struct Exposing {
  const Camera& camera;
  Eigen::Matrix4d log_from_camera;  // in the axes of the rays, when the middle row is exposed
  double time;                      // then
  CameraMotion motion = {};
};
/// A ray through the middle of each cell of scale x scale pixels, row by row; a new moment for all, or for each row if
/// the camera moves on meanwhile.
void add_cells(RayList& rays, const Exposing& photo, const Region& region, int scale);

/// A sweep in memory.
struct LoadedSweep {
  const Sweep* sweep;
  LidarPoints points;
};

/// The sweeps of a log that have a return; their points when they are asked for.
class LogSweeps {
 public:
  LogSweeps() : LogSweeps(std::vector<LoadedSweep>{}) {}
  /// All in memory.
  LogSweeps(std::vector<LoadedSweep> sweeps);  // NOLINT: sweeps in memory are sweeps
  /// counts: of the returns that `points` has of each.
  LogSweeps(const std::vector<Sweep>& sweeps, const std::vector<size_t>& counts, Stored<LidarPoints> points);

  size_t size() const { return kept_.size(); }
  const Sweep& sweep(size_t place) const { return kept_[place].sweep; }
  size_t returns(size_t place) const { return kept_[place].returns; }
  /// Fault::data for a file that is damaged.
  std::shared_ptr<const LidarPoints> points(size_t place) const { return points_[kept_[place].number]; }
  /// As HostStore::want.
  void want(size_t place, int64_t moment) const { points_.want(kept_[place].number, moment); }

 private:
  struct Kept {
    Sweep sweep;
    size_t returns, number;  // number: among points_
  };
  std::vector<Kept> kept_;
  Stored<LidarPoints> points_;
};

/// [rows,columns] of a photo's cells: the share of a cell's pixels that show an actor. Empty: not known.
using Silhouette = std::vector<float>;

/// The axes of rays, and how many pixels stand for one along each side.
struct LogRays {
  Eigen::Matrix4d log_from_world;
  int scale;
  std::vector<Silhouette> silhouettes = {};  // of each photo; empty: none
  bool rolling = false;                      // rows of photos are seen when they were exposed (Recording::shutter)
};

/// Parts of photos that are boxes of actors, as projected, drawn by class first: what of them is longer than `longest`
/// cells is cut to a random part.
struct ObjectPatches {
  int count = 1;
  int64_t longest = 48;
};

/// A photo that rays are of.
struct PhotoOf {
  size_t frame;  // place among Scene::frames
  double focal;  // pixels, at the size it is used at
};

/// Pixels of photos that rays are compared with.
struct Photographed {
  Tensor truth;                      // [N,3,h,w] in [0,1]; black where pixels do not count
  Tensor used;                       // [N,1,h,w], 0 where a mask says that the pixel does not count; empty: all count
  float share = 1;                   // of the pixels, that count
  Tensor silhouette = {};            // [rays]: share of the ray's pixels that show an actor; -1: no mask says
  std::vector<Region> objects = {};  // of a whole image, in cells
  std::vector<PhotoOf> of = {};      // each of the N
  /// The render, black where pixels do not count: no loss sees a difference there, and none sends a gradient.
  Tensor kept(const Tensor& render) const;
};

/// A step to come: its numbers, which the draws that it will make take in the same order, and whose part it is.
struct StepAhead {
  HostRandom random;
  int64_t step;
  Share share;
};

/// The images and sweeps of a log that train. Draws take their numbers from `random`, the same on all ranks. Which
/// images a step sees is decided by boxes and sizes, not by pixels, so that what the next steps need can be told:
/// expect_X announces to the photos' store what add_X will read in that step.
class LogSource {
 public:
  /// Fault::data for a log without images.
  LogSource(RestingScene scene, PhotoStore photos, LogSweeps sweeps, const LogRays& axes);

  /// The largest patch that fits every image, at most `wanted`; in rays.
  int64_t patch_side(int64_t wanted) const;
  /// The share of `count` patches of side^2 rays, every second one (if it can be) around an actor, drawn by class
  /// first, each a moment of its own. The images have side scale pixels a side. Sets rays.actors to those that all of
  /// them or their shadows may show.
  Photographed add_patches(RayList& rays, HostRandom& random, int64_t count, int64_t side, const Share& share) const;
  /// A patch around the box of one actor in sight, for each rank another of about the same size; a moment. Without
  /// truth if the photo that was drawn shows none. Marks in rays.actors those that it or their shadows may show.
  Photographed add_object(RayList& rays, HostRandom& random, const ObjectPatches& objects, const Share& share) const;
  /// One whole image, for each rank another, as far as it fills cells of scale^2 pixels; a moment. Sets rays.actors as
  /// add_patches.
  Photographed add_image(RayList& rays, HostRandom& random, const ObjectPatches& objects, const Share& share) const;
  /// The share of `count` returns of some sweeps, none of actors that rays.actors leaves out: each actor costs a
  /// decoding.
  void add_returns(RayList& rays, HostRandom& random, int64_t count, const Share& share) const;
  void expect_patches(StepAhead& ahead, int64_t count, int64_t side) const;
  void expect_object(StepAhead& ahead, const ObjectPatches& objects) const;
  void expect_image(StepAhead& ahead) const;
  void expect_returns(StepAhead& ahead, int64_t count) const;
  const PhotoStore& photos() const { return photos_; }
  size_t images() const { return photos_.size(); }
  const LogSweeps& sweeps() const { return sweeps_; }

 private:
  struct Corner {
    int64_t x, y;
  };
  /// A part of the photo at that place.
  struct Drawn {
    size_t place;
    Region region;
  };
  std::vector<Drawn> draw_patches(const Scene& scene, HostRandom& random, int64_t count, int64_t side) const;
  /// Of each rank; none: its photo shows no actor.
  std::vector<std::optional<Drawn>> draw_objects(const Scene& scene, HostRandom& random, const ObjectPatches& objects,
                                                 const Share& share) const;
  size_t draw_image(HostRandom& random, const Share& share) const;
  // What follows knows photos by their sizes and cameras; pixels are read by add_region alone.
  Corner random_corner(const FramePixels& photo, HostRandom& random, int64_t side) const;
  Corner corner_near_actor(const Scene& scene, const FramePixels& photo, HostRandom& random, int64_t side) const;
  /// The cells that hold an actor's box, its sides `stretch` as long but for its height; none: it lies behind.
  struct Span;
  std::optional<Span> span_of(const Actor& actor, const Frame& frame, const Camera& camera,
                              const Eigen::Vector3d& stretch) const;
  std::vector<Region> object_regions(const Scene& scene, const FramePixels& photo, HostRandom& random,
                                     const ObjectPatches& objects) const;
  void mark_actors(const Scene& scene, RayList& rays, const Drawn& part) const;
  /// Rays and pixels of a part of a photo, as number `place` of the photographed.
  struct HostPixels;
  void add_silhouette(const Drawn& part, HostPixels& pixels) const;
  void add_region(const Scene& scene, RayList& rays, const Drawn& part, HostPixels& pixels, int64_t place) const;
  const FramePixels& listed(size_t place) const { return photos_.listed().frames[place]; }
  const Camera& camera_of(const FramePixels& photo) const {
    return photos_.listed().cameras[static_cast<size_t>(photo.camera)];
  }

  RestingScene scene_;
  PhotoStore photos_;
  LogSweeps sweeps_;
  Eigen::Matrix4d log_from_world_;
  int scale_;
  std::vector<Silhouette> silhouettes_;
  bool rolling_;
};

}  // namespace cloam
