// See object_views.h.
#include "models/data/object_views.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>

#include "models/data/load_sweep.h"

namespace cloam {
namespace {

constexpr int kMarginOf = 20;  // a twentieth of the longer side, on each side

/// What an image shows of an actor of any class.
struct SeenBox {
  std::size_t actor = 0;
  PixelBox box;
  double distance = 0;  // of its centre, metres
  Eigen::Matrix4d box_from_camera;
};

std::vector<SeenBox> seen_boxes(const Scene& log, const Frame& frame, const Camera& camera) {
  std::vector<SeenBox> seen;
  const Eigen::Matrix4d camera_from_world = frame.world_from_camera.inverse();
  for (std::size_t i = 0; i < log.actors.size(); ++i) {
    const auto world_from_box = world_from_box_of_step(log.actors[i], frame.step, frame.timestamp);
    if (!world_from_box) continue;
    const Eigen::Matrix4d camera_from_box = camera_from_world * *world_from_box;
    if (const auto box = bounds_in_image(camera, camera_from_box, log.actors[i].size))
      seen.push_back({i, *box, camera_from_box.topRightCorner<3, 1>().norm(), camera_from_box.inverse()});
  }
  return seen;
}

double covered_by_nearer(const SeenBox& object, const std::vector<SeenBox>& all) {
  std::vector<PixelBox> nearer;
  for (const SeenBox& other : all)
    if (other.distance < object.distance) nearer.push_back(other.box);
  return covered_share(object.box, nearer);
}

PixelBox square_around(const PixelBox& box) {
  const int longer = std::max(box.width(), box.height());
  const int side = longer + 2 * ((longer + kMarginOf - 1) / kMarginOf);
  const int left = box.left - (side - box.width()) / 2, top = box.top - (side - box.height()) / 2;
  return {left, top, left + side, top + side};
}

bool shows(const ActorMask& mask, int column, int row, std::size_t actor) {
  return mask.actors[static_cast<std::size_t>(row) * static_cast<std::size_t>(mask.width) +
                     static_cast<std::size_t>(column)] == 1 + static_cast<int>(actor);
}

int pixels_in(const PixelBox& square, const ActorMask& mask, std::size_t actor) {
  int count = 0;
  for (int row = std::max(0, square.top); row < std::min(mask.height, square.bottom); ++row)
    for (int column = std::max(0, square.left); column < std::min(mask.width, square.right); ++column)
      count += shows(mask, column, row, actor);
  return count;
}

/// A thing that no pixel shows where the photo is transparent.
void take_out_clear(const FramePixels& photo, ActorMask& mask) {
  for (std::size_t i = 0; i < mask.actors.size(); ++i)
    if (photo.rgba[4 * i + 3] == 0) mask.actors[i] = 0;
}

/// All but what other actors and the LiDAR say.
ObjectView view_of(const SeenBox& seen, const Scene& log, const ActorMask& mask) {
  ObjectView object;
  object.actor = seen.actor;
  object.asset_class = asset_class(log.actors[seen.actor].label);
  object.box = seen.box;
  object.square = square_around(seen.box);
  object.box_from_camera = seen.box_from_camera;
  object.pixels = pixels_in(object.square, mask, seen.actor);
  return object;
}

ObjectOutcome outcome_of(const ObjectView& object, const ObjectFilters& filters) {
  const double outside = object.lidar_outside, points = object.lidar_inside + object.lidar_outside;
  // A quotient: that of 29 and 100 is 0.29 as it is written, 0.29 * 100 is less than 29.
  if (object.has_lidar() && outside / points > filters.most_outside) return ObjectOutcome::lidar_outside;
  if (object.pixels < filters.least_pixels) return ObjectOutcome::few_pixels;
  if (filters.training && object.covered > filters.most_covered) return ObjectOutcome::covered;
  return ObjectOutcome::kept;
}

}  // namespace

const LidarPoints& ObjectFinder::points_of_step(int step) {
  if (step_ == step) return points_;
  const auto sweep =
      std::find_if(log_.sweeps.begin(), log_.sweeps.end(), [&](const Sweep& s) { return s.step == step; });
  sweep_ = sweep == log_.sweeps.end() ? nullptr : &*sweep;
  step_.reset();  // a sweep that cannot be read is no sweep of this step
  points_ = sweep_ ? load_sweep(log_, *sweep_) : LidarPoints{};
  step_ = step;
  return points_;
}

void ObjectFinder::count_points(const Frame& frame, const Camera& camera, const ActorMask& mask, ObjectView& object) {
  const LidarPoints& points = points_of_step(frame.step);
  if (!sweep_) return;
  const Actor& actor = log_.actors[object.actor];
  // The box of a step stands where its returns were seen; else it is where the actor is at the sweep.
  const ActorBox* seen = sweep_->velocity ? box_at_step(actor, frame.step) : nullptr;
  const auto world_from_box = world_from_box_of_step(actor, frame.step, seen ? seen->timestamp : sweep_->timestamp);
  const Eigen::Matrix3d box_from_world = world_from_box->topLeftCorner<3, 3>().transpose();
  const Eigen::Vector3d centre = world_from_box->topRightCorner<3, 1>(), half = 0.5 * actor.size;
  const Eigen::Matrix4d camera_from_box = object.box_from_camera.inverse();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d offset = Eigen::Vector3f(&points.positions[3 * i]).cast<double>() - centre;
    if (offset.squaredNorm() > half.squaredNorm()) continue;
    const Eigen::Vector3d in_box = box_from_world * offset;
    if ((in_box.cwiseAbs() - half).maxCoeff() > 0) continue;
    const auto pixel = pixel_of(camera, (camera_from_box * in_box.homogeneous()).head<3>());
    if (!pixel || pixel->minCoeff() < 0 || pixel->x() >= camera.width || pixel->y() >= camera.height) continue;
    const bool inside = shows(mask, static_cast<int>(pixel->x()), static_cast<int>(pixel->y()), object.actor);
    ++(inside ? object.lidar_inside : object.lidar_outside);
  }
}

ObjectsInImage ObjectFinder::objects(const FramePixels& photo, const Camera& camera) {
  const Frame& frame = log_.frames[photo.frame];
  ObjectsInImage found{masks_.of(frame, camera), masks_.has_truth(frame), {}, 0};
  take_out_clear(photo, found.mask);
  const std::vector<SeenBox> seen = seen_boxes(log_, frame, camera);
  for (const SeenBox& box : seen) {
    if (asset_class(log_.actors[box.actor].label) == kAssetClassCount - 1) {
      ++found.other;
      continue;
    }
    ObjectView object = view_of(box, log_, found.mask);
    object.covered = covered_by_nearer(box, seen);
    count_points(frame, camera, found.mask, object);
    object.outcome = outcome_of(object, filters_);
    found.objects.push_back(object);
  }
  return found;
}

}  // namespace cloam
