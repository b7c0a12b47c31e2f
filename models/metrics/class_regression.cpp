// See class_regression.h.
#include "models/metrics/class_regression.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <set>

#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastDeviation = 1e-9;
constexpr double kStrengths[] = {100, 10, 1, 0.1, 0.01, 1e-3, 1e-4};
constexpr std::size_t kFolds = 4;
constexpr std::size_t kHistory = 10;  // steps that the curvature is known from
constexpr int kMostSteps = 300;
constexpr double kSmallGradient = 1e-5;

MatrixXd log_softmax(MatrixXd scores) {
  scores.colwise() -= scores.rowwise().maxCoeff();
  const VectorXd totals = scores.array().exp().rowwise().sum().log();
  return scores.colwise() - totals;
}

struct Loss {
  double value;
  MatrixXd gradient;
};

/// Of rows with a last column of ones; truth [N,K]: the row's weight in the column of its class.
Loss loss_of(const MatrixXd& weights, const MatrixXd& rows, const MatrixXd& truth, double strength) {
  const MatrixXd log_p = log_softmax(rows * weights);
  MatrixXd penalised = weights;
  penalised.bottomRows(1).setZero();
  const MatrixXd error = (log_p.array().exp().colwise() * truth.rowwise().sum().array()).matrix() - truth;
  return {-truth.cwiseProduct(log_p).sum() + strength / 2 * penalised.squaredNorm(),
          rows.transpose() * error + strength * penalised};
}

double dot(const MatrixXd& a, const MatrixXd& b) { return a.cwiseProduct(b).sum(); }

/// The curvature of the last steps, as L-BFGS keeps it.
class History {
 public:
  void add(const MatrixXd& step, const MatrixXd& change) {
    if (dot(step, change) <= 1e-14 * step.norm() * change.norm()) return;
    pairs_.push_back({step, change});
    if (pairs_.size() > kHistory) pairs_.pop_front();
  }

  MatrixXd downhill(MatrixXd gradient) const {
    std::vector<double> shares;
    for (auto pair = pairs_.rbegin(); pair != pairs_.rend(); ++pair) {
      shares.push_back(dot(pair->step, gradient) / dot(pair->step, pair->change));
      gradient -= shares.back() * pair->change;
    }
    if (!pairs_.empty()) gradient *= dot(pairs_.back().step, pairs_.back().change) / pairs_.back().change.squaredNorm();
    for (const auto& [step, change] : pairs_) {
      gradient += (shares.back() - dot(change, gradient) / dot(step, change)) * step;
      shares.pop_back();
    }
    return -gradient;
  }

 private:
  struct Pair {
    MatrixXd step, change;  // of weights, and of the gradient
  };
  std::deque<Pair> pairs_;
};

MatrixXd fitted(const MatrixXd& rows, const MatrixXd& truth, double strength) {
  MatrixXd weights = MatrixXd::Zero(rows.cols(), truth.cols());
  Loss loss = loss_of(weights, rows, truth, strength);
  History history;
  for (int i = 0; i < kMostSteps && loss.gradient.norm() > kSmallGradient; ++i) {
    const MatrixXd direction = history.downhill(loss.gradient);
    const double slope = dot(direction, loss.gradient);
    double length = 1;
    Loss next = loss_of(weights + direction, rows, truth, strength);
    while (next.value > loss.value + 1e-4 * length * slope && length > 1e-10)
      length /= 2, next = loss_of(weights + length * direction, rows, truth, strength);
    if (next.value >= loss.value) break;  // rounding
    history.add(length * direction, next.gradient - loss.gradient);
    weights += length * direction;
    loss = next;
  }
  return weights;
}

/// Rows of the groups that `of` chooses.
template <class Chosen>
LabelledRows part_of(const LabelledRows& rows, const Chosen& of) {
  LabelledRows part;
  std::vector<Index> places;
  for (std::size_t i = 0; i < rows.classes.size(); ++i) {
    if (!of(rows.groups[i])) continue;
    places.push_back(static_cast<Index>(i));
    part.classes.push_back(rows.classes[i]);
    part.groups.push_back(rows.groups[i]);
  }
  part.rows = rows.rows(places, Eigen::all);
  return part;
}

/// -log p of each row, summed by class. Rows of a class that was not learned say nothing of the strength.
void add_losses(const ClassRegression& regression, const LabelledRows& rows, std::map<int, double>& losses) {
  const MatrixXd log_p = regression.log_probabilities(rows.rows);
  for (std::size_t i = 0; i < rows.classes.size(); ++i) {
    const auto& classes = regression.classes();
    const auto column = std::find(classes.begin(), classes.end(), rows.classes[i]);
    if (column != classes.end()) losses[rows.classes[i]] -= log_p(static_cast<Index>(i), column - classes.begin());
  }
}

bool has_classes(const LabelledRows& rows) {
  return std::set<int>(rows.classes.begin(), rows.classes.end()).size() > 1;
}

}  // namespace

ClassRegression::ClassRegression(const LabelledRows& rows, double strength) {
  if (!has_classes(rows)) bad_data("a classifier needs rows of two classes, got ", rows.classes.size(), " rows of one");
  std::map<int, double> counts;
  for (const int one : rows.classes) ++counts[one];
  for (const auto& [one, count] : counts) classes_.push_back(one);
  mean_ = rows.rows.colwise().mean();
  deviation_ = (rows.rows.rowwise() - mean_).colwise().norm() / std::sqrt(static_cast<double>(rows.rows.rows()));
  deviation_ = deviation_.cwiseMax(kLeastDeviation);
  MatrixXd truth = MatrixXd::Zero(rows.rows.rows(), static_cast<Index>(classes_.size()));
  for (std::size_t i = 0; i < rows.classes.size(); ++i) {
    const auto column = std::lower_bound(classes_.begin(), classes_.end(), rows.classes[i]) - classes_.begin();
    truth(static_cast<Index>(i), column) = 1 / (counts[rows.classes[i]] * static_cast<double>(classes_.size()));
  }
  weights_ = fitted(standardised(rows.rows), truth, strength);
}

MatrixXd ClassRegression::standardised(const MatrixXd& rows) const {
  MatrixXd all(rows.rows(), rows.cols() + 1);
  all << ((rows.rowwise() - mean_).array().rowwise() / deviation_.array()).matrix(), VectorXd::Ones(rows.rows());
  return all;
}

MatrixXd ClassRegression::log_probabilities(const MatrixXd& rows) const {
  return log_softmax(standardised(rows) * weights_);
}

double likeliest_strength(const LabelledRows& rows) {
  const std::set<int> all(rows.groups.begin(), rows.groups.end());
  if (all.size() < 2) bad_data("how much a classifier is held back is chosen by groups left out: want two, got one");
  std::map<int, std::size_t> folds;
  for (const int group : all) folds.emplace(group, folds.size() % std::min(kFolds, all.size()));
  std::map<int, double> counts;
  for (const int one : rows.classes) ++counts[one];
  double best = kStrengths[0], least = std::numeric_limits<double>::infinity();
  for (const double strength : kStrengths) {
    std::map<int, double> losses;
    for (std::size_t fold = 0; fold < std::min(kFolds, all.size()); ++fold) {
      const LabelledRows training = part_of(rows, [&](int group) { return folds[group] != fold; });
      const LabelledRows left_out = part_of(rows, [&](int group) { return folds[group] == fold; });
      if (has_classes(training)) add_losses(ClassRegression(training, strength), left_out, losses);
    }
    double sum = 0;
    for (const auto& [one, loss] : losses) sum += loss / counts[one];
    if (sum < least) least = sum, best = strength;
  }
  return best;
}

Accuracy accuracy(const MatrixXd& log_probabilities, const std::vector<int>& columns, const std::vector<int>& classes) {
  std::map<int, double> counts;
  for (const int one : classes) ++counts[one];
  Accuracy accuracy;
  for (std::size_t i = 0; i < classes.size(); ++i) {
    Index likeliest = 0;
    log_probabilities.row(static_cast<Index>(i)).maxCoeff(&likeliest);
    const int named = columns[static_cast<std::size_t>(likeliest)], truth = classes[i];
    accuracy.named[truth][named] += 1 / counts[truth];
    if (named != truth) continue;
    accuracy.plain += 1 / static_cast<double>(classes.size());
    accuracy.balanced += 1 / (counts[truth] * static_cast<double>(counts.size()));
  }
  return accuracy;
}

}  // namespace cloam
