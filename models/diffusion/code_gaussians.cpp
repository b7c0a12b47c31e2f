// See code_gaussians.h. A covariance is a diagonal and a sum over rows z of w z z': samples need no root of a matrix.
#include "models/diffusion/code_gaussians.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>

#include "models/diffusion/spread_inverse.h"
#include "models/io/host_random.h"

namespace cloam {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Rows = std::vector<Index>;

constexpr int kAny = -1;
constexpr std::size_t kEnough = 20;  // codes of a group
constexpr Index kMostCodes = 2000;
constexpr double kLeastVariance = 1e-6;  // of a number: some never change
constexpr int kFolds = 3;
constexpr double kDiagonals[] = {0.02, 0.05, 0.1, 0.2, 0.35, 0.6, 1};
constexpr double kPooled[] = {1, 0.9, 0.75, 0.5, 0.25, 0.1, 0.03};

CodeTable part_of(const CodeTable& codes, const Rows& rows) {
  CodeTable part{codes.means(rows, Eigen::all), codes.drawn(rows, Eigen::all), {}, {}, {}};
  if (codes.variances.size() > 0) part.variances = codes.variances(rows, Eigen::all);
  for (const Index row : rows) {
    part.classes.push_back(codes.classes[static_cast<std::size_t>(row)]);
    part.nights.push_back(codes.nights[static_cast<std::size_t>(row)]);
  }
  return part;
}

CodeTable at_most(const CodeTable& codes, Index most) {
  if (codes.count() <= most) return codes;
  Rows rows;
  for (Index i = 0; i < most; ++i) rows.push_back(i * codes.count() / most);
  return part_of(codes, rows);
}

/// Box and Muller 1958.
double normal(HostRandom& random) {
  const double radius = std::sqrt(-2 * std::log(1 - random.between(0, 1)));
  return radius * std::cos(2 * std::numbers::pi * random.between(0, 1));
}

VectorXd normals(Index count, HostRandom& random) {
  return VectorXd::NullaryExpr(count, [&](Index) { return normal(random); });
}

/// The mean log-likelihood of codes left out.
double held_out_likelihood(const std::vector<CodeTable>& training, const std::vector<CodeTable>& left_out,
                           const Shrinkage& shrinkage) {
  double sum = 0;
  Index count = 0;
  for (std::size_t fold = 0; fold < training.size(); ++fold) {
    sum += CodeGaussians(training[fold], shrinkage).log_likelihood(left_out[fold]) *
           static_cast<double>(left_out[fold].count());
    count += left_out[fold].count();
  }
  return sum / static_cast<double>(count);
}

Shrinkage mixed(double diagonal, double pooled) { return {1 - pooled, pooled * (1 - diagonal), pooled * diagonal}; }

}  // namespace

CodeGaussians::CodeGaussians(const CodeTable& all, const Shrinkage& shrinkage) : shrinkage_(shrinkage) {
  const CodeTable codes = at_most(all, kMostCodes);
  noise_ = VectorXd::Zero(codes.means.cols());
  if (codes.variances.size() > 0) noise_ = codes.variances.colwise().mean();
  add_groups(codes);
  total_ = (pooled_share_ * rows_.colwise().squaredNorm().transpose() + noise_).cwiseMax(kLeastVariance);
}

void CodeGaussians::add_group(const CodeTable& codes, int asset_class, int night) {
  Group group{asset_class, night, VectorXd::Zero(codes.means.cols()), {}, 0, false};
  for (Index i = 0; i < codes.count(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (asset_class != kAny && codes.classes[at] != asset_class) continue;
    if (night != kAny && codes.nights[at] != night) continue;
    group.members.push_back(i);
    group.mean += codes.means.row(i);
  }
  group.mean /= static_cast<double>(group.members.size());
  group.own = asset_class != kAny && group.members.size() >= kEnough;
  groups_.push_back(std::move(group));
}

void CodeGaussians::add_groups(const CodeTable& codes) {
  std::map<std::pair<int, int>, std::size_t> counts;
  for (std::size_t i = 0; i < codes.classes.size(); ++i) {
    ++counts[{codes.classes[i], kAny}];
    ++counts[{codes.classes[i], codes.nights[i]}];
  }
  for (const auto& [kind, count] : counts)
    if (kind.second == kAny || count >= kEnough) add_group(codes, kind.first, kind.second);
  add_group(codes, kAny, kAny);
  rows_ = codes.means;
  std::vector<bool> met(groups_.size());
  for (Index i = 0; i < codes.count(); ++i) {
    const std::size_t group =
        group_of(codes.classes[static_cast<std::size_t>(i)], codes.nights[static_cast<std::size_t>(i)] != 0);
    rows_.row(i) -= groups_[group].mean.transpose();
    met[group] = true;
  }
  const auto means = static_cast<double>(std::count(met.begin(), met.end(), true));
  pooled_share_ = 1 / std::max(1.0, static_cast<double>(codes.count()) - means);
  for (Group& group : groups_) {
    group.share = group.own ? 1 / static_cast<double>(group.members.size() - 1) : pooled_share_;
    if (group.own) continue;
    group.members.resize(static_cast<std::size_t>(codes.count()));
    std::iota(group.members.begin(), group.members.end(), 0);
  }
}

std::size_t CodeGaussians::group_of(int asset_class, bool night) const {
  std::size_t found = groups_.size() - 1;
  for (std::size_t i = 0; i + 1 < groups_.size(); ++i) {
    if (groups_[i].asset_class != asset_class) continue;
    if (groups_[i].night == int{night}) return i;
    if (groups_[i].night == kAny) found = i;
  }
  return found;
}

std::vector<Rows> CodeGaussians::by_group(const std::vector<int>& classes, const std::vector<int>& nights) const {
  std::vector<Rows> rows(groups_.size());
  for (std::size_t i = 0; i < classes.size(); ++i)
    rows[group_of(classes[i], nights[i] != 0)].push_back(static_cast<Index>(i));
  return rows;
}

VectorXd CodeGaussians::diagonal() const {
  const VectorXd noise = (shrinkage_.own + shrinkage_.pooled) * noise_;
  return noise + shrinkage_.diagonal * total_;
}

const VectorXd& CodeGaussians::mean(int asset_class, bool night) const {
  return groups_[group_of(asset_class, night)].mean;
}

MatrixXd CodeGaussians::covariance(int asset_class, bool night) const {
  const Group& group = groups_[group_of(asset_class, night)];
  const MatrixXd members = rows_(group.members, Eigen::all);
  MatrixXd all = shrinkage_.pooled * pooled_share_ * rows_.transpose() * rows_;
  all += shrinkage_.own * group.share * members.transpose() * members;
  all.diagonal() += diagonal();
  return all;
}

VectorXd CodeGaussians::sample(int asset_class, bool night, uint64_t seed, uint64_t n) const {
  const Group& group = groups_[group_of(asset_class, night)];
  HostRandom random(seed, n);
  VectorXd weights = std::sqrt(shrinkage_.pooled * pooled_share_) * normals(rows_.rows(), random);
  const double root = std::sqrt(shrinkage_.own * group.share);
  VectorXd code = group.mean + diagonal().cwiseSqrt().cwiseProduct(normals(rows_.cols(), random));
  code += rows_.transpose() * weights;
  for (const Index member : group.members) code += root * normal(random) * rows_.row(member).transpose();
  return code;
}

MatrixXd CodeGaussians::velocity(const MatrixXd& noisy, const std::vector<int>& classes, const std::vector<int>& nights,
                                 const Level& level) const {
  const double signal = level.alpha * level.alpha, noise = level.sigma * level.sigma;
  const auto inverse =
      spread_inverse(rows_, (signal * diagonal()).array() + noise, signal * shrinkage_.pooled * pooled_share_);
  MatrixXd velocity(noisy.rows(), noisy.cols());
  const std::vector<Rows> rows = by_group(classes, nights);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (rows[g].empty()) continue;
    const Eigen::RowVectorXd mean = groups_[g].mean;
    inverse->choose(groups_[g].members, signal * shrinkage_.own * groups_[g].share);
    const MatrixXd y = MatrixXd(noisy(rows[g], Eigen::all)).rowwise() - level.alpha * mean;
    // alpha^2 S = A - sigma^2, so that x^ = m + (y - sigma^2 A^-1 y) / alpha.
    velocity(rows[g], Eigen::all) = -level.sigma * (((y - inverse->solve(y)) / level.alpha).rowwise() + mean);
  }
  return velocity;
}

double CodeGaussians::log_likelihood(const CodeTable& codes) const {
  const auto inverse = spread_inverse(rows_, diagonal(), shrinkage_.pooled * pooled_share_);
  const std::vector<Rows> rows = by_group(codes.classes, codes.nights);
  double sum = 0;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (rows[g].empty()) continue;
    inverse->choose(groups_[g].members, shrinkage_.own * groups_[g].share);
    const MatrixXd y = MatrixXd(codes.drawn(rows[g], Eigen::all)).rowwise() - groups_[g].mean.transpose();
    const double constant = inverse->log_determinant() + static_cast<double>(y.cols()) * std::log(2 * std::numbers::pi);
    sum -= (y.cwiseProduct(inverse->solve(y)).sum() + static_cast<double>(y.rows()) * constant) / 2;
  }
  return sum / static_cast<double>(codes.count());
}

Shrinkage likeliest_shrinkage(const CodeTable& all, uint64_t seed) {
  const CodeTable codes = at_most(all, kMostCodes);
  if (codes.count() < kFolds) return {};
  std::vector<Index> order(static_cast<std::size_t>(codes.count()));
  std::iota(order.begin(), order.end(), 0);
  HostRandom random(seed);
  for (std::size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random.below(i + 1)]);
  std::vector<CodeTable> training, left_out;
  for (int fold = 0; fold < kFolds; ++fold) {
    Rows parts[2];
    for (std::size_t i = 0; i < order.size(); ++i) parts[static_cast<int>(i) % kFolds == fold].push_back(order[i]);
    training.push_back(part_of(codes, parts[0]));
    left_out.push_back(part_of(codes, parts[1]));
  }
  double diagonal = 1, pooled = 1, best = -std::numeric_limits<double>::infinity();
  const auto try_both = [&](double of_diagonal, double of_pooled) {
    const double likelihood = held_out_likelihood(training, left_out, mixed(of_diagonal, of_pooled));
    if (likelihood > best) best = likelihood, diagonal = of_diagonal, pooled = of_pooled;
  };
  for (const double share : kDiagonals) try_both(share, 1);
  for (const double share : kPooled) try_both(diagonal, share);
  if (pooled < 1)
    for (const double share : kDiagonals) try_both(share, pooled);
  return mixed(diagonal, pooled);
}

}  // namespace cloam
