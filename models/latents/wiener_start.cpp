// See wiener_start.h.
#include "models/latents/wiener_start.h"

#include <Eigen/Eigenvalues>

#include "models/io/tensors.h"
#include "models/latents/code_denoiser.h"
#include "models/scene/asset_class.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int64_t kTimes = kTimesOfDay + 1, kKinds = (kAssetClassCount + 1) * kTimes;  // one more each: not given

std::vector<float> as_floats(const Eigen::MatrixXd& values) {
  const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = values.cast<float>();
  return {rows.data(), rows.data() + rows.size()};
}

}  // namespace

WienerStart::WienerStart(int64_t numbers)
    : basis_(zeros({numbers, numbers})), variances_(ones({numbers})), means_(zeros({kKinds, numbers})) {}

void WienerStart::fit(const CodeGaussians& gaussians) {
  // What no code is of stands for all of them.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> found(gaussians.covariance(kAssetClassCount, false));
  Eigen::MatrixXd means(kKinds, found.eigenvalues().size());
  for (int kind = 0; kind < kKinds; ++kind) {
    const int asset_class = kind / static_cast<int>(kTimes), night = kind % static_cast<int>(kTimes);
    means.row(kind) = gaussians.mean(night == kTimesOfDay ? kAssetClassCount : asset_class, night == 1).transpose();
  }
  basis_ = from_host(as_floats(found.eigenvectors()), basis_.shape());
  variances_ = from_host(as_floats(found.eigenvalues()), variances_.shape());
  means_ = from_host(as_floats(means), means_.shape());
  fitted_ = true;
}

Tensor WienerStart::velocity(const NoiseSchedule& schedule, const Tensor& noisy, const Tensor& t,
                             const Condition& condition) const {
  const int64_t count = noisy.dim(0);
  const Tensor one = ones({count, 1}), none = zeros({count, 1});
  const Tensor alpha = schedule.noisy(one, none, t), sigma = schedule.noisy(none, one, t);
  const auto label = [&](size_t i) { return cast(condition.labels.at(i), DType::f32); };
  const Tensor kinds = label(0) * static_cast<float>(kTimes) + label(1);
  const Tensor mean = gather_rows(means_, cast(kinds, DType::i32));
  const Tensor y = matmul(reshape(noisy, {count, -1}) - mean * alpha, basis_);
  const Tensor gain = (1.f - variances_) * (alpha * sigma) / (variances_ * square(alpha) + square(sigma));
  return reshape(matmul(y * gain, transpose(basis_, 0, 1)) - mean * sigma, noisy.shape());
}

TensorMap WienerStart::state() const {
  return {{"wiener.basis", named(basis_)}, {"wiener.variances", named(variances_)}, {"wiener.means", named(means_)}};
}

void WienerStart::restore(const TensorMap& state) {
  basis_ = tensor_from(state, "wiener.basis", basis_.shape());
  variances_ = tensor_from(state, "wiener.variances", variances_.shape());
  means_ = tensor_from(state, "wiener.means", means_.shape());
  fitted_ = true;
}

}  // namespace cloam
