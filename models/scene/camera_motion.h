// How a camera moves on while it exposes an image row by row: a rolling shutter.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// In the camera's axes as they are when the middle row is exposed. Defaults: all rows at once.
struct CameraMotion {
  double shutter = 0;                                  // seconds from the first row to the last
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // metres a second
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();      // radians a second about its direction

  /// When the place y (pixels from the top) is exposed: seconds after the middle row.
  double seconds_after(double y, int height) const { return shutter * (y / height - 0.5); }
  /// The camera so many seconds later, in its axes then.
  Eigen::Matrix4d moved(double seconds) const;
};

/// Of a camera of the log at a time, from its photos before and after (at the ends, the two nearest). All rows at once
/// where Recording::shutter is 0, and for a camera without two photos.
CameraMotion camera_motion(const Scene& scene, const std::string& sensor, double time);

}  // namespace cloam
