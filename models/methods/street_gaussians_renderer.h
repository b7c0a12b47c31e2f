// What cameras and LiDARs see of a trained street of gaussians.
#pragma once
#include "models/methods/street_gaussians_model.h"

namespace cloam {

/// With any lens. Depths are those that light comes from on average, where gaussians cover at least half of it.
Picture picture_of(const StreetGaussiansModel& model, const View& view);

/// The actor on white. box_from_camera: as Street::render_asset.
Picture asset_picture(const StreetGaussiansModel& model, std::size_t actor, const Camera& camera,
                      const Eigen::Matrix4d& box_from_camera);

/// Gaussians are drawn by pinholes: rays that begin in one place at one time are looked up in depth pictures from
/// there, 0.09 degrees a pixel. 1 / depth along the axis is linear in a plane's picture, so it is what is read between
/// pixels; at edges the nearest pixel counts.
LidarReturns returns_of(const StreetGaussiansModel& model, const WorldRays& rays);

}  // namespace cloam
