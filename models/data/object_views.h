// The actors that an image of a log shows, and which of them show well enough for a benchmark of objects: the filters
// of GenAssets (CVPR 2025, supplement, C.1).
#pragma once
#include <optional>
#include <vector>

#include "models/data/actor_masks.h"
#include "models/scene/asset_class.h"
#include "models/scene/box_projection.h"
#include "models/scene/lidar_points.h"
#include "models/scene/pixels.h"

namespace cloam {

struct ObjectFilters {
  double most_outside = 0.3;  // of the LiDAR points of the box that the image shows, outside of the mask
  int least_pixels = 100;     // of the mask
  bool training = false;      // what follows is for images that train
  double most_covered = 0.5;  // of the 2-D box, by the 2-D boxes of nearer actors
};

/// In the order of the filters; the first that rejects an object is told.
enum class ObjectOutcome { kept, lidar_outside, few_pixels, covered };
constexpr int kObjectOutcomes = 4;

/// One actor in one image.
struct ObjectView {
  std::size_t actor = 0;  // place in Scene::actors
  int asset_class = 0;
  PixelBox box;     // of its projected box, within the image
  PixelBox square;  // about the middle of that: its longer side and a twentieth more on each side; may leave the image
  Eigen::Matrix4d box_from_camera = Eigen::Matrix4d::Identity();
  int pixels = 0;                           // of the mask, in the square
  int lidar_inside = 0, lidar_outside = 0;  // points of the box that the image shows, on the mask and beside it
  double covered = 0;                       // share of the 2-D box
  ObjectOutcome outcome = ObjectOutcome::kept;

  bool has_lidar() const { return lidar_inside + lidar_outside > 0; }
};

struct ObjectsInImage {
  ActorMask mask;          // without what is transparent in the photo
  bool mask_file = false;  // the mask comes from a file; else it is the outlines of the boxes
  std::vector<ObjectView> objects;
  std::size_t other = 0;  // actors of no class of Table A1, which are left out
};

class ObjectFinder {
 public:
  ObjectFinder(const Scene& log, const ActorMasks& masks, const ObjectFilters& filters)
      : log_(log), masks_(masks), filters_(filters) {}

  /// All actors with a box at the frame's step that projects into the image. A moving actor's box is taken at the time
  /// of the sweep to find its points, which then move with it to the time of the image. An object without a point of
  /// its own in the image passes the first filter: nothing speaks against its mask. camera: the photo's, as loaded.
  /// Asked step by step, this reads each sweep once. Fault::data for masks and sweeps that are damaged.
  ObjectsInImage objects(const FramePixels& photo, const Camera& camera);

 private:
  const LidarPoints& points_of_step(int step);
  void count_points(const Frame& frame, const Camera& camera, const ActorMask& mask, ObjectView& object);

  const Scene& log_;
  const ActorMasks& masks_;
  const ObjectFilters filters_;
  std::optional<int> step_;  // whose points are held
  const Sweep* sweep_ = nullptr;
  LidarPoints points_;
};

}  // namespace cloam
