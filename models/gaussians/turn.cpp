// See turn.h.
#include "models/gaussians/turn.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <array>
#include <cmath>

namespace cloam {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// The real harmonics of one degree at a direction of length 1, in 3DGS's order and signs. A factor that all of a degree
// have in common is left out: it makes no difference to how they turn.
VectorXd harmonics(int degree, const Vector3d& d) {
  const double x = d.x(), y = d.y(), z = d.z(), xx = x * x, yy = y * y, zz = z * z;
  VectorXd values(2 * degree + 1);
  if (degree == 1) {
    values << -y, z, -x;
  } else if (degree == 2) {
    values << x * y, -y * z, (2 * zz - xx - yy) / std::sqrt(12), -x * z, (xx - yy) / 2;
  } else {
    values << -y * (3 * xx - yy) / std::sqrt(24), x * y * z, -y * (4 * zz - xx - yy) / std::sqrt(40),
        z * (2 * zz - 3 * xx - 3 * yy) / std::sqrt(60), -x * (4 * zz - xx - yy) / std::sqrt(40), z * (xx - yy) / 2,
        -x * (xx - 3 * yy) / std::sqrt(24);
  }
  return values;
}

// Directions that tell all harmonics of a degree apart: on a spiral from pole to pole.
std::vector<Vector3d> directions() {
  constexpr int kCount = 24;
  std::vector<Vector3d> all;
  for (int i = 0; i < kCount; ++i) {
    const double z = 1 - (2 * i + 1.0) / kCount, angle = 2.4 * i, radius = std::sqrt(1 - z * z);
    all.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
  }
  return all;
}

// A turned colour c'(d) = c(R^-1 d) is again a sum of the harmonics Y of the same degree: Y(R^-1 d) = D Y(d), so its
// coefficients are D^T times the old ones. D follows from enough directions.
MatrixXd band_rotation(int degree, const Matrix3d& rotation) {
  const std::vector<Vector3d> all = directions();
  MatrixXd here(all.size(), 2 * degree + 1), before(all.size(), 2 * degree + 1);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    here.row(row) = harmonics(degree, all[i]);
    before.row(row) = harmonics(degree, rotation.transpose() * all[i]);
  }
  // The directions lie so evenly that the columns of `here` are nearly orthogonal: normal equations lose nothing.
  const MatrixXd solved =
      here.transpose().lazyProduct(here).eval().ldlt().solve(here.transpose().lazyProduct(before).eval());  // D^T
  // What is 0 but for rounding would let a coefficient seep into all others of its degree.
  return (solved.array().abs() < 1e-12).select(0, solved);
}

void turn_harmonics(std::vector<float>& rest, const Matrix3d& rotation) {
  Eigen::Index begin = 0;
  for (int degree = 1; degree <= kSphericalBands; begin += 2 * degree + 1, ++degree) {
    const Eigen::Index size = 2 * degree + 1;
    const MatrixXd turn = band_rotation(degree, rotation);
    for (std::size_t at = 0; at < rest.size(); at += 3 * kSphericalRest) {
      using Rows = Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>;
      Eigen::Map<Rows> band(rest.data() + at + 3 * static_cast<std::size_t>(begin), size, 3);
      const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::ColMajor, 7, 3> after =
          turn.lazyProduct(band.cast<double>());
      band = after.cast<float>();
    }
  }
}

}  // namespace

Matrix3d turn_between(const Vector3d& from, const Vector3d& to) {
  if (from.dot(to) < -1 + 1e-9) {
    // Half a turn about x where that is across; else about another axis across.
    const Vector3d across = std::abs(from.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY();
    const Vector3d axis = (across - across.dot(from) * from).normalized();
    return 2 * axis * axis.transpose() - Matrix3d::Identity();
  }
  // Half a turn about `from` and half a turn about the axis midway turn by twice the angle between these axes.
  const Vector3d midway = (from + to).normalized();
  const Matrix3d half_turn = 2 * from * from.transpose() - Matrix3d::Identity();
  return 2 * midway * (midway.transpose() * half_turn) - half_turn;
}

void transform(Gaussians& gaussians, const Similarity& new_from_old) {
  const Eigen::Quaterniond turn(new_from_old.rotation);
  const float growth = static_cast<float>(std::log(new_from_old.scale));
  for (std::size_t g = 0; g < gaussians.count(); ++g) {
    Eigen::Map<Eigen::Vector3f> mean(&gaussians.means[3 * g]);
    mean =
        (new_from_old.scale * (new_from_old.rotation * mean.cast<double>()) + new_from_old.translation).cast<float>();
    float* q = &gaussians.rotations[4 * g];
    const Eigen::Quaterniond turned_rotation = turn * Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    q[0] = static_cast<float>(turned_rotation.w());
    for (int i = 0; i < 3; ++i) q[i + 1] = static_cast<float>(turned_rotation.vec()[i]);
  }
  for (float& scale : gaussians.scales) scale += growth;
  turn_harmonics(gaussians.sh_rest, new_from_old.rotation);
  gaussians.up = new_from_old.rotation * gaussians.up;
}

Gaussians turned(const Gaussians& gaussians, const Eigen::Vector3d& up) {
  Gaussians result = gaussians;
  const Vector3d from = gaussians.up.normalized(), to = up.normalized();
  if ((from - to).norm() > 1e-9) transform(result, {turn_between(from, to)});
  result.up = up;
  return result;
}

}  // namespace cloam
