// Gaussians of codes: what is drawn from a known one is described by it, and its denoiser is as good as theory says.
#include "models/diffusion/code_gaussians.h"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <random>

#include "models/diffusion/spread_inverse.h"
#include "models/latents/code_denoiser.h"
#include "models/latents/wiener_start.h"
#include "models/scene/asset_class.h"
#include "runtime/ops.h"

using namespace cloam;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

MatrixXd normals(Index rows, Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
}

/// A covariance far from a diagonal.
MatrixXd some_covariance(Index size, unsigned seed) {
  const MatrixXd root = normals(size, size, seed);
  return root * root.transpose() / static_cast<double>(size) + 0.1 * MatrixXd::Identity(size, size);
}

MatrixXd drawn(const VectorXd& mean, const MatrixXd& covariance, Index count, unsigned seed) {
  const MatrixXd root = covariance.llt().matrixL();
  return (normals(count, mean.size(), seed) * root.transpose()).rowwise() + mean.transpose();
}

void add(CodeTable& table, const MatrixXd& codes, int asset_class, int night) {
  const Index before = table.count();
  table.means.conservativeResize(before + codes.rows(), codes.cols());
  table.means.bottomRows(codes.rows()) = codes;
  table.drawn = table.means;
  table.classes.resize(static_cast<std::size_t>(table.count()), asset_class);
  table.nights.resize(static_cast<std::size_t>(table.count()), night);
}

CodeTable plain_codes(const MatrixXd& codes, int asset_class = 0, int night = 0) {
  CodeTable table;
  add(table, codes, asset_class, night);
  return table;
}

double relative(const MatrixXd& a, const MatrixXd& b) { return (a - b).norm() / b.norm(); }

/// Two classes, the second by night too, 60, 30 and 25 codes, and a third of 3; with variances of their own.
CodeTable mixed_codes() {
  CodeTable table;
  add(table, drawn(VectorXd::Constant(8, 1), some_covariance(8, 1), 60, 2), 0, 0);
  add(table, drawn(VectorXd::Constant(8, -1), some_covariance(8, 3), 30, 4), 5, 0);
  add(table, drawn(VectorXd::Constant(8, 3), some_covariance(8, 5), 25, 6), 5, 1);
  add(table, drawn(VectorXd::Constant(8, 9), some_covariance(8, 7), 3, 8), 2, 1);
  table.variances = normals(table.count(), 8, 9).cwiseAbs2() * 0.2;
  table.drawn = table.means + table.variances.cwiseSqrt().cwiseProduct(normals(table.count(), 8, 10));
  return table;
}

constexpr Shrinkage kMixed = {0.5, 0.3, 0.2};

}  // namespace

TEST_CASE(
    "gaussians: covariances are mixtures of the group's, the pooled and its diagonal, with the codes' own noise") {
  const CodeTable codes = mixed_codes();
  const CodeGaussians gaussians(codes, kMixed);
  const auto covariance_of = [](const MatrixXd& rows, double count) {
    const MatrixXd centred = rows.rowwise() - rows.colwise().mean();
    return MatrixXd(centred.transpose() * centred / count);
  };
  const MatrixXd parts[] = {codes.means.topRows(60), codes.means.middleRows(60, 30), codes.means.middleRows(90, 25),
                            codes.means.bottomRows(3)};
  MatrixXd pooled = MatrixXd::Zero(8, 8);
  for (const MatrixXd& part : parts) pooled += covariance_of(part, 118 - 4);
  const MatrixXd noise = MatrixXd(codes.variances.colwise().mean().asDiagonal());
  const MatrixXd diagonal = MatrixXd((pooled + noise).diagonal().asDiagonal());
  const auto mixture = [&](const MatrixXd& own) {
    return MatrixXd(0.5 * (own + noise) + 0.3 * (pooled + noise) + 0.2 * diagonal);
  };
  CHECK(relative(gaussians.covariance(5, true), mixture(covariance_of(parts[2], 24))) < 1e-12);
  CHECK(relative(gaussians.covariance(0, false), mixture(covariance_of(parts[0], 59))) < 1e-12);
  CHECK(relative(gaussians.covariance(0, true), gaussians.covariance(0, false)) < 1e-12);  // none by night: its class
  CHECK(relative(gaussians.covariance(2, true), mixture(pooled)) < 1e-12);                 // too few
  CHECK((gaussians.mean(5, true) - parts[2].colwise().mean().transpose()).norm() < 1e-12);
  CHECK((gaussians.mean(2, false) - parts[3].colwise().mean().transpose()).norm() < 1e-12);
  CHECK((gaussians.mean(7, false) - codes.means.colwise().mean().transpose()).norm() < 1e-12);  // unknown
}

TEST_CASE("gaussians: the likelihood is that of the dense formula") {
  const CodeTable codes = mixed_codes();
  for (const Shrinkage& shrinkage : {kMixed, Shrinkage{0, 0.6, 0.4}, Shrinkage{}}) {
    const CodeGaussians gaussians(codes, shrinkage);
    double want = 0;
    for (Index i = 0; i < codes.count(); ++i) {
      const int asset_class = codes.classes[static_cast<std::size_t>(i)];
      const bool night = codes.nights[static_cast<std::size_t>(i)] == 1;
      const MatrixXd covariance = gaussians.covariance(asset_class, night);
      const VectorXd apart = codes.drawn.row(i).transpose() - gaussians.mean(asset_class, night);
      want -=
          (apart.dot(covariance.inverse() * apart) + std::log((2 * std::numbers::pi * covariance).determinant())) / 2;
    }
    CHECK(gaussians.log_likelihood(codes) == doctest::Approx(want / static_cast<double>(codes.count())).epsilon(1e-9));
  }
}

TEST_CASE("gaussians: the denoiser is Wiener's filter, by the dense formula, for each code's own class and time") {
  const CodeTable codes = mixed_codes();
  const CodeGaussians gaussians(codes, kMixed);
  for (const double alpha : {0.999, 0.6, 0.01}) {
    const double sigma = std::sqrt(1 - alpha * alpha);
    const MatrixXd noisy = normals(codes.count(), 8, 11);
    const MatrixXd velocity = gaussians.velocity(noisy, codes.classes, codes.nights, {alpha, sigma});
    for (const Index i : {0, 70, 100, 117}) {
      const int asset_class = codes.classes[static_cast<std::size_t>(i)];
      const bool night = codes.nights[static_cast<std::size_t>(i)] == 1;
      const MatrixXd s = gaussians.covariance(asset_class, night);
      const VectorXd mean = gaussians.mean(asset_class, night), x = noisy.row(i).transpose();
      const MatrixXd of_noisy = alpha * alpha * s + sigma * sigma * MatrixXd::Identity(8, 8);
      const VectorXd clean = mean + alpha * s * of_noisy.inverse() * (x - alpha * mean);
      CHECK((velocity.row(i).transpose() - (alpha * x - clean) / sigma).norm() < 1e-8);
    }
  }
}

TEST_CASE("gaussians: inverses by rows and by the whole matrix are those of the dense formula") {
  for (const Index count : {7, 40}) {  // fewer and more than dimensions
    const MatrixXd rows = normals(count, 15, 40), y = normals(4, 15, 41);
    const VectorXd diagonal = normals(15, 1, 42).cwiseAbs().array() + 0.1;
    const std::vector<Index> members = {0, 3, 6};
    const auto inverse = spread_inverse(rows, diagonal, 0.7);
    MatrixXd dense = MatrixXd(diagonal.asDiagonal()) + 0.7 * rows.transpose() * rows;
    CHECK(relative(inverse->solve(y), y * dense.inverse()) < 1e-10);
    CHECK(inverse->log_determinant() == doctest::Approx(std::log(dense.determinant())));
    const MatrixXd some = rows(members, Eigen::all);
    dense += 0.4 * some.transpose() * some;
    inverse->choose(members, 0.4);
    CHECK(relative(inverse->solve(y), y * dense.inverse()) < 1e-10);
    CHECK(inverse->log_determinant() == doctest::Approx(std::log(dense.determinant())));
  }
}

TEST_CASE("gaussians: on codes of a known Gaussian the Wiener loss is the least that theory allows") {
  const MatrixXd covariance = some_covariance(12, 20);
  const VectorXd mean = VectorXd::Constant(12, 0.5);
  const CodeTable codes = plain_codes(drawn(mean, covariance, 2000, 21));
  const Shrinkage shrinkage = likeliest_shrinkage(codes, 1);
  CHECK(shrinkage.diagonal < 0.05);  // there is enough to see of all of it
  const CodeGaussians gaussians(codes, shrinkage);
  const MatrixXd fresh = drawn(mean, covariance, 4000, 22), noise = normals(4000, 12, 23);
  const std::vector<int> zeros(4000);
  for (const double alpha : {0.95, 0.7, 0.3}) {
    const double sigma = std::sqrt(1 - alpha * alpha);
    const MatrixXd target = alpha * noise - sigma * fresh;
    const double loss = (gaussians.velocity(alpha * fresh + sigma * noise, zeros, zeros, {alpha, sigma}) - target)
                            .array()
                            .square()
                            .mean();
    // The variance of v given x_t is that of x over sigma^2: S (alpha^2 S + sigma^2)^-1.
    const MatrixXd of_noisy = alpha * alpha * covariance + sigma * sigma * MatrixXd::Identity(12, 12);
    const double least = (covariance * of_noisy.inverse()).trace() / 12;
    CHECK(loss == doctest::Approx(least).epsilon(0.03));
    CHECK(loss < target.array().square().mean());
  }
}

TEST_CASE("gaussians: few codes in many dimensions shrink, and classes of unlike shapes keep their own") {
  const CodeTable few = plain_codes(normals(24, 60, 30));
  const Shrinkage heavy = likeliest_shrinkage(few, 1);
  CHECK(heavy.diagonal > 0.5);
  CodeTable unlike;
  VectorXd wide = VectorXd::Constant(6, 0.1), tall = wide;
  wide.head(3).setConstant(4), tall.tail(3).setConstant(4);
  add(unlike, drawn(VectorXd::Zero(6), wide.asDiagonal(), 400, 31), 0, 0);
  add(unlike, drawn(VectorXd::Zero(6), tall.asDiagonal(), 400, 32), 1, 0);
  CHECK(likeliest_shrinkage(unlike, 1).own > 0.9);
  CodeTable alike;
  for (const int asset_class : {0, 1, 2, 3})
    add(alike, drawn(VectorXd::Constant(12, asset_class), some_covariance(12, 33), 25, 34 + unsigned(asset_class)),
        asset_class, 0);
  CHECK(likeliest_shrinkage(alike, 1).own < 0.3);
}

TEST_CASE("gaussians: samples have mean and covariance, and are the same for the same seed and place") {
  const CodeTable codes = mixed_codes();
  const CodeGaussians gaussians(codes, kMixed);
  constexpr Index kCount = 20000;
  MatrixXd samples(kCount, 8);
  for (Index i = 0; i < kCount; ++i)
    samples.row(i) = gaussians.sample(5, true, 3, static_cast<uint64_t>(i)).transpose();
  const MatrixXd centred = samples.rowwise() - samples.colwise().mean();
  CHECK(relative(centred.transpose() * centred / double{kCount - 1}, gaussians.covariance(5, true)) < 0.03);
  CHECK((samples.colwise().mean().transpose() - gaussians.mean(5, true)).norm() < 0.1);
  CHECK(gaussians.sample(5, true, 3, 7) == samples.row(7).transpose());
  CHECK(gaussians.sample(5, true, 4, 7) != samples.row(7).transpose());
  CHECK(gaussians.sample(0, true, 3, 7) != samples.row(7).transpose());
}

TEST_CASE("gaussians: a denoiser on the device that knows means and one covariance is Wiener's filter") {
  const CodeTable table = mixed_codes();
  const CodeGaussians gaussians(table, {0, 0.7, 0.3});  // no group's own covariance
  const NoiseSchedule schedule;
  const Shape shape = {5, 2, 2, 2};
  const MatrixXd values = normals(5, 8, 21);
  std::vector<float> noisy;
  for (Index i = 0; i < 5; ++i)
    for (Index k = 0; k < 8; ++k) noisy.push_back(static_cast<float>(values(i, k)));
  const std::vector<int32_t> classes = {0, 5, 5, 7, kAssetClassCount}, nights = {0, 0, 1, 0, kTimesOfDay};
  const std::vector<int> host_classes = {0, 5, 5, 7, -2}, host_nights = {0, 0, 1, 0, 0};  // -2: of none
  WienerStart start(8);
  const auto velocity = [&](int32_t time) {
    const Tensor t = from_host(std::vector<int32_t>(5, time), {5});
    return start.velocity(schedule, from_host(noisy, shape), t, asset_condition(classes, nights)).to_host();
  };
  for (const float v : velocity(300)) CHECK(v == 0);  // that of standard normal codes
  start.fit(gaussians);
  for (const int32_t time : {0, 20, 300, 700, 999}) {
    const MatrixXd truth = gaussians.velocity(values, host_classes, host_nights, schedule.level(time));
    const std::vector<float> found = velocity(time);
    CAPTURE(time);
    for (Index i = 0; i < 5; ++i)
      for (Index k = 0; k < 8; ++k)
        CHECK(double{found[static_cast<std::size_t>(8 * i + k)]} == doctest::Approx(truth(i, k)).epsilon(2e-4));
  }
  const std::vector<float> before = velocity(300);
  const TensorMap state = start.state();
  start = WienerStart(8);
  start.restore(state);
  CHECK(start.fitted());
  CHECK(velocity(300) == before);
}
