// Inverses of covariances that are a diagonal and sums over rows: of few rows in many dimensions, and of many in few.
#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

namespace cloam {

/// Of A = diagonal + weight Z'Z + share C'C, where C are some of the rows of Z [N,d].
class SpreadInverse {
 public:
  virtual ~SpreadInverse() = default;
  /// Which rows C are; none until this is called.
  virtual void choose(const std::vector<Eigen::Index>& members, double share) = 0;
  virtual double log_determinant() const = 0;
  /// A^-1 y for rows y [M,d].
  virtual Eigen::MatrixXd solve(const Eigen::MatrixXd& y) const = 0;
};

/// By the identity of Woodbury where there are fewer rows than dimensions, else by the matrix itself: work grows with
/// the third power of the smaller one. The rows must live as long as this. diagonal [d]: above 0.
std::unique_ptr<SpreadInverse> spread_inverse(const Eigen::MatrixXd& rows, const Eigen::VectorXd& diagonal,
                                              double weight);

}  // namespace cloam
