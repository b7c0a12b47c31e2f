// Gaussians in another frame. Colours that depend on the direction turn with the world.
#pragma once
#include <Eigen/Core>

#include "models/gaussians/gaussians.h"

namespace cloam {

/// Rotation times scale, then translation: new from old.
struct Similarity {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  double scale = 1;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

/// Moves means, deviations, rotations, harmonics and `up`.
void transform(Gaussians& gaussians, const Similarity& new_from_old);

/// The shortest rotation that takes a unit vector to another; where the two are opposite, half a turn about x, which
/// takes COLMAP's axes (x right, y down, z forward) to OpenGL's (x right, y up, z back).
Eigen::Matrix3d turn_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// The same scene with `up` as its up axis, by turn_between. Not a bit changes where `up` is its up axis already.
Gaussians turned(const Gaussians& gaussians, const Eigen::Vector3d& up);

}  // namespace cloam
