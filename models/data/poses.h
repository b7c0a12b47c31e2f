// Camera poses and intrinsics from files: checked, and brought to the project's axes.
#pragma once
#include <Eigen/Core>
#include <string>

#include "models/scene/camera.h"

namespace cloam {

/// world_from_camera with OpenCV axes (x right, y down, z forward) from one with OpenGL axes (x right, y up, z back).
Eigen::Matrix4d opencv_from_opengl_pose(const Eigen::Matrix4d& world_from_camera);

/// The pose with an exact rotation: a uniform scale and small rounding errors are taken out. Fault::data, with
/// `where` at its head, for mirrored, sheared or empty matrices and for positions beyond 1e7.
Eigen::Matrix4d rigid(const Eigen::Matrix4d& world_from_camera, const std::string& where);

/// A side of an image in pixels, as the file's `key` gives it. Fault::data, with `where` at its head, for what is none.
int image_side(double value, const std::string& key, const std::string& where);

/// Fault::data, with `where` at its head, for focal lengths and centres that no camera has.
void require_sound(const Camera& camera, const std::string& where);

}  // namespace cloam
