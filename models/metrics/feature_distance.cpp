// See feature_distance.h.
#include "models/metrics/feature_distance.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::MatrixXd;

void need_sets(const MatrixXd& a, const MatrixXd& b) {
  if (a.rows() < 2 || b.rows() < 2 || a.cols() != b.cols() || a.cols() == 0)
    throw Error(Fault::data,
                text("a distance of two sets needs two images each and one kind of features, got ", a.rows(), " and ",
                     b.rows(), " images with ", a.cols(), " and ", b.cols(), " features"));
}

Tensor unit_length(const Tensor& map) { return map * rsqrt(sum(square(map), {{1}, true}) + 1e-10f); }

MatrixXd covariance(const MatrixXd& rows) {
  const MatrixXd centred = rows.rowwise() - rows.colwise().mean();
  return centred.transpose() * centred / static_cast<double>(rows.rows() - 1);
}

/// Eigenvalues of a covariance are no less than 0; rounding may say otherwise.
Eigen::VectorXd roots(const Eigen::VectorXd& eigenvalues) { return eigenvalues.cwiseMax(0).cwiseSqrt(); }

/// (x.y / C + 1)^3 of all pairs of rows.
MatrixXd kernel(const MatrixXd& a, const MatrixXd& b) {
  return (a * b.transpose() / static_cast<double>(a.cols())).array().operator+(1).cube().matrix();
}

/// Mean over pairs of different rows.
double mean_within(const MatrixXd& set) {
  const MatrixXd all = kernel(set, set);
  return (all.sum() - all.trace()) / static_cast<double>(set.rows() * (set.rows() - 1));
}

}  // namespace

std::string feature_distance_name(const FeatureNetwork& network, const std::string& kind) {
  return text(kind, kind.empty() ? "" : " ", "feature distance (", network.name, ")");
}

Tensor feature_distance(const FeatureNetwork& network, const Tensor& a, const Tensor& b) {
  match("feature_distance", {{"a", a, "N 3 H W"}, {"b", b, "N 3 H W"}});
  const Tensors of_a = network(a), of_b = network(b);
  Tensor total = 0.f;
  for (size_t i = 0; i < of_a.size(); i++)
    total = total + mean(sum(square(unit_length(of_a[i]) - unit_length(of_b[i])), {{1}}), {{1, 2}});
  return total / static_cast<float>(of_a.size());
}

MatrixXd pooled_features(const FeatureNetwork& network, const Tensor& images) {
  const Tensor pooled = mean(network(images).back(), {{2, 3}});
  const std::vector<float> values = pooled.to_host();
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Rows>(values.data(), pooled.dim(0), pooled.dim(1)).cast<double>();
}

// A B has the eigenvalues of the symmetric A^(1/2) B A^(1/2), whose decomposition is exact and real.
double frechet_distance(const MatrixXd& a, const MatrixXd& b) {
  need_sets(a, b);
  const MatrixXd cov_a = covariance(a), cov_b = covariance(b);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> of_a(cov_a);
  const MatrixXd root = of_a.eigenvectors() * roots(of_a.eigenvalues()).asDiagonal() * of_a.eigenvectors().transpose();
  const Eigen::SelfAdjointEigenSolver<MatrixXd> product(root * cov_b * root, Eigen::EigenvaluesOnly);
  const double means = (a.colwise().mean() - b.colwise().mean()).squaredNorm();
  return means + cov_a.trace() + cov_b.trace() - 2 * roots(product.eigenvalues()).sum();
}

double kernel_distance(const MatrixXd& a, const MatrixXd& b) {
  need_sets(a, b);
  return mean_within(a) + mean_within(b) - 2 * kernel(a, b).mean();
}

}  // namespace cloam
