// Classes by logistic regression, where its answer is known.
#include "models/metrics/class_regression.h"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "runtime/error.h"

using namespace cloam;
using Eigen::Index;
using Eigen::MatrixXd;

namespace {

/// Rows of class 3 about `apart`, of class 8 about 0, deviation 1, and numbers that say nothing. Classes in turns.
LabelledRows two_classes(Index count, Index silent, double apart, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  LabelledRows rows;
  rows.rows = MatrixXd::NullaryExpr(count, 1 + silent, [&] { return normal(random); });
  for (Index i = 0; i < count; ++i) {
    rows.classes.push_back(i % 2 == 0 ? 3 : 8);
    rows.groups.push_back(static_cast<int>(i / 2 % 8));
    if (i % 2 == 0) rows.rows(i, 0) += apart;
  }
  return rows;
}

}  // namespace

TEST_CASE("class regression: of two Gaussians the log odds are those of Bayes' rule") {
  const ClassRegression regression(two_classes(20000, 1, 2, 1), 1e-6);
  CHECK(regression.classes() == std::vector<int>{3, 8});
  MatrixXd places(3, 2);
  places << -1, 0, 1, 0, 2, 3;
  const MatrixXd log_p = regression.log_probabilities(places);
  for (Index i = 0; i < 3; ++i) {
    const double x = places(i, 0), odds = 2 * x - 2;  // (x^2 - (x - 2)^2) / 2
    CHECK(log_p(i, 0) - log_p(i, 1) == doctest::Approx(odds).epsilon(0.06).scale(1));
    CHECK(std::exp(log_p(i, 0)) + std::exp(log_p(i, 1)) == doctest::Approx(1));
  }
}

TEST_CASE("class regression: classes count alike, however many rows they have") {
  LabelledRows rows = two_classes(6000, 0, 2, 2);
  for (std::size_t i = 0; i < rows.classes.size(); i += 2)
    if (i % 20 != 0) rows.classes[i] = 8, rows.rows(static_cast<Index>(i), 0) -= 2;
  const MatrixXd log_p = ClassRegression(rows, 1e-6).log_probabilities(MatrixXd::Constant(1, 1, 1));
  CHECK(log_p(0, 0) - log_p(0, 1) == doctest::Approx(0).epsilon(0.2).scale(1));  // in the middle; by rows -2.9
}

TEST_CASE("class regression: the loss is least: its gradient, by differences of the whole, is zero") {
  const LabelledRows rows = two_classes(60, 3, 1, 3);
  const ClassRegression regression(rows, 0.1);
  // With strength s the gradient by a weight is sum (p - truth) z / N + s w = 0, with w from differences of log odds.
  const MatrixXd log_p = regression.log_probabilities(rows.rows);
  const Eigen::RowVectorXd mean = rows.rows.colwise().mean();
  const Eigen::RowVectorXd deviation = (rows.rows.rowwise() - mean).colwise().norm() / std::sqrt(60.0);
  const auto odds_at = [&](const Eigen::RowVectorXd& place) {
    const MatrixXd p = regression.log_probabilities(place);
    return p(0, 0) - p(0, 1);
  };
  for (Index k = 0; k < 4; ++k) {
    double gradient = 0;
    for (Index i = 0; i < 60; ++i)
      gradient += (std::exp(log_p(i, 0)) - (i % 2 == 0)) * (rows.rows(i, k) - mean[k]) / deviation[k] / 60;
    Eigen::RowVectorXd further = mean;
    further[k] += deviation[k];
    const double weight = (odds_at(further) - odds_at(mean)) / 2;  // those of two classes are opposite
    CHECK(gradient + 0.1 * weight == doctest::Approx(0).scale(1).epsilon(1e-4));
  }
}

TEST_CASE("class regression: the strength fits what there is to learn") {
  CHECK(likeliest_strength(two_classes(4000, 4, 2, 4)) <= 0.01);
  CHECK(likeliest_strength(two_classes(40, 200, 0, 5)) >= 10);  // nothing to learn
}

TEST_CASE("class regression: the strength is chosen by groups left out, not by rows") {
  // Each group is of one class and has a number of its own, which tells the class of its rows and of no others.
  LabelledRows rows = two_classes(160, 0, 0.5, 6);
  MatrixXd all = MatrixXd::Zero(160, 17);
  all.leftCols(1) = rows.rows;
  for (Index i = 0; i < 160; ++i) {
    rows.groups[static_cast<std::size_t>(i)] = static_cast<int>(i / 20) * 2 + static_cast<int>(i % 2);
    all(i, 1 + rows.groups[static_cast<std::size_t>(i)]) = 5;
  }
  rows.rows = all;
  LabelledRows shuffled = rows;
  for (std::size_t i = 0; i < 160; ++i) shuffled.groups[i] = static_cast<int>(i) / 2 % 4;
  CHECK(likeliest_strength(rows) >= 0.1);
  CHECK(likeliest_strength(shuffled) <= 0.01);
}

TEST_CASE("class regression: accuracy of all rows, and as the mean of the classes' own") {
  MatrixXd log_p(5, 2);
  log_p << -1, -2, -1, -2, -1, -2, -2, -1, -1, -2;  // says 4, 4, 4, 6, 4
  const Accuracy right = accuracy(log_p, {4, 6}, {4, 4, 4, 6, 6});
  CHECK(right.plain == doctest::Approx(0.8));
  CHECK(right.balanced == doctest::Approx(0.75));
  CHECK(right.named.at(4).at(4) == doctest::Approx(1));
  CHECK(right.named.at(6) == std::map<int, double>{{4, 0.5}, {6, 0.5}});
}

TEST_CASE("class regression: rows of one class, and strengths from one group, are told") {
  LabelledRows rows = two_classes(10, 1, 1, 7);
  rows.groups.assign(10, 2);
  CHECK_THROWS_WITH_AS(likeliest_strength(rows), doctest::Contains("want two, got one"), Error);
  rows.classes.assign(10, 3);
  CHECK_THROWS_WITH_AS(ClassRegression(rows, 1), doctest::Contains("rows of two classes"), Error);
}
