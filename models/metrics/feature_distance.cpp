// See feature_distance.h.
#include "models/metrics/feature_distance.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "models/nn/inception.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::MatrixXd;

void need_sets(const MatrixXd& a, const MatrixXd& b) {
  if (a.rows() < 2 || b.rows() < 2 || a.cols() != b.cols() || a.cols() == 0)
    bad_data("a distance of two sets needs two images in each and the same features, got ", a.rows(), " and ", b.rows(),
             " images with ", a.cols(), " and ", b.cols(), " features");
}

Tensor unit_length(const Tensor& map) { return map * rsqrt(sum(square(map), {{1}, true}) + 1e-10f); }

/// [min(N,C),C] with covariance() of rows as its transpose times itself.
MatrixXd root_of_covariance(const MatrixXd& rows) {
  const MatrixXd centred = (rows.rowwise() - rows.colwise().mean()) / std::sqrt(static_cast<double>(rows.rows() - 1));
  if (rows.rows() <= rows.cols()) return centred;
  const Eigen::HouseholderQR<MatrixXd> factors(centred);
  return factors.matrixQR().topRows(rows.cols()).triangularView<Eigen::Upper>();
}

/// The singular values of M are the eigenvalues of [0 M'; M 0] but for their signs (Golub and Kahan, 1965). Exact to
/// rounding, unlike roots of the eigenvalues of M'M, and a third of what Eigen's SVD takes to compile.
double sum_of_singular_values(const MatrixXd& m) {
  MatrixXd both = MatrixXd::Zero(m.rows() + m.cols(), m.rows() + m.cols());
  both.bottomLeftCorner(m.rows(), m.cols()) = m;  // the solver reads the lower triangle
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(both, Eigen::EigenvaluesOnly).eigenvalues().cwiseAbs().sum() / 2;
}

/// (x.y / C + 1)^3 of all pairs of rows.
MatrixXd kernel(const MatrixXd& a, const MatrixXd& b) {
  return (a * b.transpose() / static_cast<double>(a.cols())).array().operator+(1).cube().matrix();
}

/// Mean over pairs of different rows.
double mean_within(const MatrixXd& set) {
  const MatrixXd all = kernel(set, set);
  return (all.sum() - all.trace()) / static_cast<double>(set.rows() * (set.rows() - 1));
}

/// `count` different rows, each choice equally likely.
MatrixXd drawn_rows(const MatrixXd& from, int64_t count, std::mt19937_64& random) {
  std::vector<Eigen::Index> rows(static_cast<size_t>(from.rows()));
  std::iota(rows.begin(), rows.end(), 0);
  for (size_t i = 0; i < static_cast<size_t>(count); i++) std::swap(rows[i], rows[i + random() % (rows.size() - i)]);
  rows.resize(static_cast<size_t>(count));
  return from(rows, Eigen::all);
}

}  // namespace

std::string feature_distance_name(const std::string& network, const std::string& kind) {
  if (network == kInception && kind == "Frechet") return "FID";
  if (network == kInception && kind == "kernel") return "KID";
  return text(kind, kind.empty() ? "" : " ", "feature distance (", network, ")");
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
  const Tensor bytes = floor(clamp(images, 0.f, 1.f) * 255.f + 0.5f);
  const Tensor pooled = mean(network(bytes / 255.f).back(), {{2, 3}});
  const std::vector<float> values = pooled.to_host();
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Rows>(values.data(), pooled.dim(0), pooled.dim(1)).cast<double>();
}

// With A = X'X and B = Y'Y, the eigenvalues of A B = X'(X Y')Y, but for zeros, are those of (Y X')(X Y'): the squares
// of the singular values of X Y'. No root is taken of a rounding error, so that singular covariances do no harm.
double frechet_distance(const MatrixXd& a, const MatrixXd& b) {
  need_sets(a, b);
  const MatrixXd root_a = root_of_covariance(a), root_b = root_of_covariance(b);
  const double means = (a.colwise().mean() - b.colwise().mean()).squaredNorm();
  return means + root_a.squaredNorm() + root_b.squaredNorm() - 2 * sum_of_singular_values(root_a * root_b.transpose());
}

double kernel_distance(const MatrixXd& a, const MatrixXd& b) {
  need_sets(a, b);
  return mean_within(a) + mean_within(b) - 2 * kernel(a, b).mean();
}

SubsetDistance kernel_distance_of_subsets(const MatrixXd& a, const MatrixXd& b, const Subsets& subsets) {
  need_sets(a, b);
  if (std::max(a.rows(), b.rows()) <= subsets.size) return {kernel_distance(a, b), 0, 1};
  const int64_t size_a = std::min(a.rows(), subsets.size), size_b = std::min(b.rows(), subsets.size);
  std::mt19937_64 random(subsets.seed);
  double sum = 0, squares = 0;
  for (int i = 0; i < subsets.count; i++) {
    const MatrixXd of_a = drawn_rows(a, size_a, random);
    const double distance = kernel_distance(of_a, drawn_rows(b, size_b, random));
    sum += distance, squares += distance * distance;
  }
  const double mean = sum / subsets.count;
  return {mean, std::sqrt(std::max(0.0, squares / subsets.count - mean * mean)), subsets.count};
}

SetDistances set_distances(const MatrixXd& a, const MatrixXd& b) {
  return {frechet_distance(a, b), kernel_distance_of_subsets(a, b), a.rows(), b.rows(), a.cols()};
}

}  // namespace cloam
