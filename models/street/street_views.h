// What cameras and LiDARs see of a street, from what a method says that rays see: block by block, so that memory does
// not grow with the picture.
#pragma once
#include <functional>

#include "models/batches/log_source.h"
#include "models/street/street.h"
#include "models/street/street_space.h"

namespace cloam {

/// What rays see, [R,...], evaluated.
struct SeenByRays {
  Tensor features;                // [R,F]
  Tensor light;                   // [R,3]: what shadows leave; empty: all
  Tensor depth, opacity;          // [R] metres along the ray; without the sky
  Tensor actor_opacity;           // [R]
  std::vector<int32_t> owners{};  // [R] place of the actor that gives most light; -1: none
  Tensor intensity{}, drop{};     // [R] as LidarReturns; empty: not known
};

/// A method's part: what rays see, and pixels from maps of it. features [1,F,h,w] and light [1,3,h,w] (or empty) give
/// [1,3,h scale,w scale].
struct StreetPainter {
  std::function<SeenByRays(const RayList& rays)> look;
  std::function<Tensor(const Tensor& features, const Tensor& light)> image;
  int scale = 1;  // pixels a ray, along each side
};

/// motion: of the camera while it exposes the picture.
Picture street_picture(const StreetPainter& painter, const View& view, const StreetSpace& space,
                       const CameraMotion& motion = {});
LidarReturns street_returns(const StreetPainter& painter, const WorldRays& rays, const StreetSpace& space);
/// On white, the sky left out. box_from_camera: as Street::render_asset.
Picture asset_picture(const StreetPainter& painter, const Camera& camera, const Eigen::Matrix4d& box_from_camera);

}  // namespace cloam
