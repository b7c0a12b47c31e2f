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

/// At a share of the way from one rigid pose to another: the position linear, the rotation spherical. Shares below 0
/// and above 1 go straight on.
inline Eigen::Matrix4d pose_between(const Eigen::Matrix4d& from, const Eigen::Matrix4d& to, double share) {
  const Eigen::Quaterniond a(Eigen::Matrix3d(from.topLeftCorner<3, 3>())), b(Eigen::Matrix3d(to.topLeftCorner<3, 3>()));
  return pose_from(a.slerp(share, b).toRotationMatrix(),
                   (1 - share) * from.topRightCorner<3, 1>() + share * to.topRightCorner<3, 1>());
}

}  // namespace cloam
