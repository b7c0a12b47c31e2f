// Poses as matrices.
#pragma once
#include <Eigen/Geometry>

namespace cloam {

/// About the vertical by an angle in radians, counter-clockwise from above.
inline Eigen::Matrix3d turn_about_z(double angle) {
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// Turned, then moved.
inline Eigen::Matrix4d pose_from(const Eigen::Matrix3d& turn, const Eigen::Vector3d& position) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() = turn;
  pose.topRightCorner<3, 1>() = position;
  return pose;
}

}  // namespace cloam
