// See spread_inverse.h.
#include "models/diffusion/spread_inverse.h"

#include <Eigen/Cholesky>

namespace cloam {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Members = std::vector<Index>;

double log_determinant_of(const Eigen::LLT<MatrixXd>& factor) {
  return 2 * factor.matrixLLT().diagonal().array().log().sum();
}

/// A^-1 y = (y - Z'k) / diagonal with coefficients k [N].
class OfRows final : public SpreadInverse {
 public:
  OfRows(const MatrixXd& rows, VectorXd diagonal, double weight)
      : diagonal_(std::move(diagonal)), weight_(weight), scaled_(rows * diagonal_.cwiseInverse().asDiagonal()) {
    const MatrixXd whitened = rows * diagonal_.cwiseSqrt().cwiseInverse().asDiagonal();
    const Index count = rows.rows();
    products_ = MatrixXd::Zero(count, count);
    products_.selfadjointView<Eigen::Lower>().rankUpdate(whitened);
    products_.triangularView<Eigen::StrictlyUpper>() = products_.transpose();
    const Eigen::LLT<MatrixXd> factor(MatrixXd::Identity(count, count) + weight_ * products_);
    inner_ = factor.solve(MatrixXd::Identity(count, count));
    log_determinant_ = diagonal_.array().log().sum() + log_determinant_of(factor);
  }

  void choose(const Members& members, double share) override {
    members_ = share > 0 ? members : Members();
    share_ = share;
    const auto count = static_cast<Index>(members_.size());
    const MatrixXd seen = MatrixXd(inner_(members_, Eigen::all)) * MatrixXd(products_(Eigen::all, members_));
    own_.compute(MatrixXd::Identity(count, count) + share * 0.5 * (seen + seen.transpose()));
  }

  double log_determinant() const override {
    return log_determinant_ + (members_.empty() ? 0 : log_determinant_of(own_));
  }

  MatrixXd solve(const MatrixXd& y) const override {
    const MatrixXd pooled = y * scaled_.transpose() * inner_;
    MatrixXd coefficients = weight_ * pooled;
    if (!members_.empty()) {
      const MatrixXd own = own_.solve(MatrixXd(pooled(Eigen::all, members_)).transpose()).transpose();
      coefficients += share_ * own * MatrixXd(inner_(members_, Eigen::all));
    }
    return y * diagonal_.cwiseInverse().asDiagonal() - coefficients * scaled_;
  }

 private:
  VectorXd diagonal_;
  double weight_, share_ = 0, log_determinant_ = 0;
  MatrixXd scaled_, products_, inner_;  // Z / diagonal, Z Z' / diagonal, (1 + weight products)^-1
  Members members_;
  Eigen::LLT<MatrixXd> own_;
};

class Dense final : public SpreadInverse {
 public:
  Dense(const MatrixXd& rows, const VectorXd& diagonal, double weight) : rows_(rows), pooled_(diagonal.asDiagonal()) {
    pooled_.selfadjointView<Eigen::Lower>().rankUpdate(rows.transpose(), weight);
    factor_.compute(pooled_);
  }

  void choose(const Members& members, double share) override {
    MatrixXd all = pooled_;
    if (share > 0)
      all.selfadjointView<Eigen::Lower>().rankUpdate(MatrixXd(rows_(members, Eigen::all)).transpose(), share);
    factor_.compute(all);
  }

  double log_determinant() const override { return log_determinant_of(factor_); }
  MatrixXd solve(const MatrixXd& y) const override { return factor_.solve(y.transpose()).transpose(); }

 private:
  const MatrixXd& rows_;
  MatrixXd pooled_;  // its lower half
  Eigen::LLT<MatrixXd> factor_;
};

}  // namespace

std::unique_ptr<SpreadInverse> spread_inverse(const MatrixXd& rows, const VectorXd& diagonal, double weight) {
  if (rows.rows() < rows.cols()) return std::make_unique<OfRows>(rows, diagonal, weight);
  return std::make_unique<Dense>(rows, diagonal, weight);
}

}  // namespace cloam
