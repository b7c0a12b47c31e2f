// See poses.h.
#include "models/data/poses.h"

#include <Eigen/Dense>
#include <cmath>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kRotationTolerance = 0.01;  // files with 3 digits still pass
constexpr double kFarthest = 1e7;            // beyond it float32 has no use left
constexpr int kLongestSide = 1 << 17;        // pixels

}  // namespace

Eigen::Matrix4d opencv_from_opengl_pose(const Eigen::Matrix4d& world_from_camera) {
  Eigen::Matrix4d pose = world_from_camera;
  pose.block<3, 2>(0, 1) *= -1;
  return pose;
}

int image_side(double value, const std::string& key, const std::string& where) {
  if (value >= 1 && value <= kLongestSide && value == std::floor(value)) return static_cast<int>(value);
  bad_data(where, ": ", key, " is ", value, ", want a whole number of pixels up to ", kLongestSide);
}

Eigen::Matrix4d rigid(const Eigen::Matrix4d& world_from_camera, const std::string& where) {
  const Eigen::Matrix3d turn = world_from_camera.topLeftCorner<3, 3>();
  const double determinant = turn.determinant(), scale = std::cbrt(determinant);
  if (!(scale > 1e-3 && scale < 1e3))
    bad_data(where, ": the pose's rotation has determinant ", determinant, ", want 1",
             determinant < 0 ? " (a mirrored axis)" : "");
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(turn / scale, Eigen::ComputeFullU | Eigen::ComputeFullV);
  // JacobiSVD stops without singular values when an entry is not finite.
  const bool found = svd.info() == Eigen::Success;
  const double shear = found ? (svd.singularValues() - Eigen::Vector3d::Ones()).cwiseAbs().maxCoeff() : 1e9;
  if (!(shear < kRotationTolerance))
    bad_data(where, ": the pose does not hold a rotation: its axes differ in length by a factor of ", 1 + shear,
             " or are not at right angles");
  if (!(world_from_camera.topRightCorner<3, 1>().cwiseAbs().maxCoeff() < kFarthest))
    bad_data(where, ": the position is more than ", kFarthest, " units from the origin");
  Eigen::Matrix4d pose = world_from_camera;
  if (shear > 1e-12 || std::abs(scale - 1) > 1e-12)
    pose.topLeftCorner<3, 3>() = svd.matrixU() * svd.matrixV().transpose();
  return pose;
}

void require_sound(const Camera& camera, const std::string& where) {
  const double longest = 1e6;
  const bool focal = camera.fx > 1e-3 && camera.fx < longest && camera.fy > 1e-3 && camera.fy < longest;
  const bool centre = std::abs(camera.cx) < longest && std::abs(camera.cy) < longest;
  if (focal && centre) return;
  bad_data(where, ": implausible intrinsics: focal lengths fx ", camera.fx, ", fy ", camera.fy, ", centre cx ",
           camera.cx, ", cy ", camera.cy, " pixels");
}

}  // namespace cloam
