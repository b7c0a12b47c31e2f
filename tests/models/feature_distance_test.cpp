// Feature distances against closed forms of Gaussians and against plain loops.
#include "models/metrics/feature_distance.h"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>

#include "runtime/error.h"

using namespace cloam;
using Eigen::MatrixXd;

namespace {

MatrixXd normals(int rows, int columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  MatrixXd values(rows, columns);
  for (int i = 0; i < rows; i++)
    for (int j = 0; j < columns; j++) values(i, j) = normal(random);
  return values;
}

MatrixXd covariance_by_loops(const MatrixXd& rows) {
  MatrixXd all = MatrixXd::Zero(rows.cols(), rows.cols());
  for (int i = 0; i < rows.rows(); i++)
    for (int j = 0; j < rows.cols(); j++)
      for (int k = 0; k < rows.cols(); k++)
        all(j, k) += (rows(i, j) - rows.col(j).mean()) * (rows(i, k) - rows.col(k).mean());
  return all / static_cast<double>(rows.rows() - 1);
}

}  // namespace

TEST_CASE("Frechet distance of Gaussian samples is that of their closed form") {
  // Independent coordinates: |difference of means|^2 + sum (sigma_a - sigma_b)^2.
  const Eigen::RowVector3d sigma_a(1, 2, 0.5), sigma_b(2, 1, 0.5), shift(1, 0, -0.5);
  const MatrixXd a = normals(20000, 3, 1) * sigma_a.asDiagonal();
  const MatrixXd b = (normals(20000, 3, 2) * sigma_b.asDiagonal()).rowwise() + shift;
  const double want = shift.squaredNorm() + (sigma_a - sigma_b).squaredNorm();
  CHECK(frechet_distance(a, b) == doctest::Approx(want).epsilon(0.03));
}

TEST_CASE("Frechet distance with covariances that do not commute") {
  Eigen::Matrix2d mix_a, mix_b;
  mix_a << 1, 0.7, -0.2, 0.5;
  mix_b << 0.3, 0, 1.1, 0.9;
  const MatrixXd a = normals(40, 2, 1) * mix_a, b = normals(30, 2, 2) * mix_b;
  // The trace of a 2x2 matrix's root is sqrt(trace + 2 sqrt(determinant)).
  const MatrixXd cov_a = covariance_by_loops(a), cov_b = covariance_by_loops(b), product = cov_a * cov_b;
  const double root = std::sqrt(product.trace() + 2 * std::sqrt(product.determinant()));
  const double means = (a.colwise().mean() - b.colwise().mean()).squaredNorm();
  CHECK(frechet_distance(a, b) == doctest::Approx(means + cov_a.trace() + cov_b.trace() - 2 * root).epsilon(1e-9));
}

TEST_CASE("Frechet distance: zero for equal sets, whatever their order, and with fewer images than features") {
  const MatrixXd a = normals(12, 20, 1);
  MatrixXd turned = a.colwise().reverse();
  CHECK(std::abs(frechet_distance(a, a)) < 1e-6);
  CHECK(std::abs(frechet_distance(a, turned)) < 1e-6);
  const MatrixXd b = normals(9, 20, 2);
  CHECK(frechet_distance(a, b) == doctest::Approx(frechet_distance(b, turned)).epsilon(1e-6));
  CHECK(frechet_distance(a, b) > 1);
  const MatrixXd many = 30 * normals(300, 200, 3), more = normals(250, 200, 4);
  CHECK(std::abs(frechet_distance(many, many)) < 1e-6);
  CHECK(frechet_distance(many, more) ==
        doctest::Approx(frechet_distance(more.colwise().reverse(), many)).epsilon(1e-9));
  CHECK_THROWS_WITH_AS(frechet_distance(a, b.topRows(1)), doctest::Contains("got 12 and 1 images"), Error);
  CHECK_THROWS_AS(kernel_distance(a, b.leftCols(3)), Error);
}

TEST_CASE("kernel distance is unbiased: its mean over small samples is the closed form") {
  // In one dimension the kernel (xy + 1)^3 compares the first three moments: 3 d1^2 + 3 d2^2 + d3^2, and those of
  // N(0,1) and N(1/2,1) are 0, 1, 0 and 1/2, 5/4, 13/8. The biased form would be larger by several.
  const double want = 3 * 0.25 + 3 * 0.0625 + 1.625 * 1.625;
  constexpr int kDraws = 4000, kSize = 8;
  const MatrixXd a = normals(kDraws, kSize, 1), b = normals(kDraws, kSize, 2).array() + 0.5;
  double sum = 0, squares = 0, alike = 0, alike_squares = 0;
  for (int i = 0; i < kDraws; i++) {
    const double apart = kernel_distance(a.row(i).transpose(), b.row(i).transpose());
    const double same = kernel_distance(a.row(i).transpose(), b.row(i).transpose().array() - 0.5);
    sum += apart, squares += apart * apart, alike += same, alike_squares += same * same;
  }
  const auto error = [](double total, double of_squares) {
    return std::sqrt((of_squares / kDraws - total / kDraws * total / kDraws) / kDraws);
  };
  CHECK(std::abs(sum / kDraws - want) < 4 * error(sum, squares));
  CHECK(std::abs(alike / kDraws) < 3 * error(alike, alike_squares));
  CHECK(error(sum, squares) < 0.5);
}

TEST_CASE("kernel distance of subsets: their mean is the whole sets' distance, and the seed decides") {
  // A mean over all subsets would be exactly that distance, being unbiased; over some it is near.
  const MatrixXd a = normals(60, 5, 1), b = normals(45, 5, 2).array() + 0.3;
  const SubsetDistance found = kernel_distance_of_subsets(a, b, {20, 2000, 1});
  const double error = found.deviation / std::sqrt(2000.0);
  CHECK(std::abs(found.mean - kernel_distance(a, b)) < 4 * error);
  CHECK(error < 0.01);  // the biased form would be 0.2 more
  CHECK(found.subsets == 2000);
  CHECK(kernel_distance_of_subsets(a, b, {20, 9, 1}).mean == kernel_distance_of_subsets(a, b, {20, 9, 1}).mean);
  CHECK(kernel_distance_of_subsets(a, b, {20, 9, 1}).mean != kernel_distance_of_subsets(a, b, {20, 9, 2}).mean);
  // A set of the subset's size is taken whole, the larger one is not.
  CHECK(kernel_distance_of_subsets(a.topRows(20), b, {20, 9, 1}).subsets == 9);
  CHECK(kernel_distance_of_subsets(a, b, {60, 9, 1}).mean == kernel_distance(a, b));
  CHECK(kernel_distance_of_subsets(a, b, {60, 9, 1}).deviation == 0);
  const MatrixXd turned = a.colwise().reverse();
  CHECK(kernel_distance(turned, b) == doctest::Approx(kernel_distance(a, b)).epsilon(1e-9));
}

TEST_CASE("FID and KID are the names of the published Inception's features alone") {
  CHECK(feature_distance_name("inception-v3-2015-12-05", "Frechet") == "FID");
  CHECK(feature_distance_name("inception-v3-2015-12-05", "kernel") == "KID");
  CHECK(feature_distance_name("inception-v3-2015-12-05, unverified weights", "Frechet") ==
        "Frechet feature distance (inception-v3-2015-12-05, unverified weights)");
  CHECK(feature_distance_name("inception-v3-2015-12-05") == "feature distance (inception-v3-2015-12-05)");
  const SetDistances found = set_distances(normals(12, 4, 1), normals(9, 4, 2));
  CHECK(found.frechet == frechet_distance(normals(12, 4, 1), normals(9, 4, 2)));
  CHECK(found.kernel.mean == kernel_distance(normals(12, 4, 1), normals(9, 4, 2)));
  CHECK(found.images_a == 12);
  CHECK(found.images_b == 9);
  CHECK(found.features == 4);
}

TEST_CASE("feature distance of images: LPIPS's form by loops, zero for equal images, larger for more noise") {
  const FeatureNetwork net = random_features();
  const Shape shape{2, 3, 16, 16};
  const Tensor a = random_uniform(shape, {1}), noise = random_normal(shape, {2});
  const Tensor b = clamp(a + 0.1f * noise, 0.f, 1.f);
  const Tensors of_a = net(a), of_b = net(b);
  double want = 0;  // of the second image
  for (size_t t = 0; t < of_a.size(); t++) {
    const int64_t channels = of_a[t].dim(1), places = of_a[t].dim(2) * of_a[t].dim(3);
    const std::vector<float> va = of_a[t].to_host(), vb = of_b[t].to_host();
    for (int64_t place = 0; place < places; place++) {
      double aa = 0, bb = 0, ab = 0;
      for (int64_t c = channels; c < 2 * channels; c++) {
        const auto i = static_cast<size_t>(c * places + place);
        aa += double{va[i]} * double{va[i]}, bb += double{vb[i]} * double{vb[i]}, ab += double{va[i]} * double{vb[i]};
      }
      want += (2 - 2 * ab / std::sqrt(aa * bb)) / static_cast<double>(places * static_cast<int64_t>(of_a.size()));
    }
  }
  const std::vector<float> near = feature_distance(net, a, b).to_host();
  const std::vector<float> far = feature_distance(net, a, clamp(a + 0.3f * noise, 0.f, 1.f)).to_host();
  CHECK(near[1] == doctest::Approx(want).epsilon(1e-4));
  CHECK(far[0] > 2 * near[0]);
  CHECK(feature_distance(net, a, a).to_host() == std::vector<float>{0, 0});
  std::vector<float> bytes = a.to_host(), bright = bytes;
  for (float& value : bytes) value = std::round(255 * value) / 255;
  for (float& value : bright) value += 1;
  const Tensor deepest = net(from_host(bytes, shape)).back();
  CHECK(pooled_features(net, a).rows() == 2);
  CHECK(pooled_features(net, a)(1, 3) ==
        doctest::Approx(mean(slice(slice(deepest, 0, 1, 2), 1, 3, 4)).item()).epsilon(1e-6));
  CHECK(pooled_features(net, a) == pooled_features(net, from_host(bytes, shape)));
  CHECK(pooled_features(net, from_host(bright, shape)) == pooled_features(net, ones(shape)));
  CHECK(feature_distance_name(net.name) == "feature distance (random features)");
  CHECK(feature_distance_name(net.name, "Frechet") == "Frechet feature distance (random features)");
}
