// The linear schedule.
#include "models/diffusion/schedule.h"

#include <cmath>
#include <vector>

#include "runtime/ops.h"

namespace cloam {
namespace {

/// table[t], shaped to stand before [N, ...].
Tensor at(const Tensor& table, const Tensor& t, const Tensor& like) {
  Shape shape = Shape::filled(like.rank(), 1);
  shape[0] = t.dim(0);
  return reshape(gather_rows(table, t), shape);
}

}  // namespace

LinearSchedule::LinearSchedule(int64_t times) {
  std::vector<float> alpha, sigma;
  double kept = 1;  // alpha^2
  for (int64_t t = 0; t < times; t++) {
    kept *= 1 - (1e-4 + (0.02 - 1e-4) * static_cast<double>(t) / static_cast<double>(times > 1 ? times - 1 : 1));
    alpha.push_back(static_cast<float>(std::sqrt(kept)));
    sigma.push_back(static_cast<float>(std::sqrt(1 - kept)));
  }
  alpha_ = from_host(alpha, {times});
  sigma_ = from_host(sigma, {times});
}

Tensor LinearSchedule::noisy(const Tensor& x, const Tensor& noise, const Tensor& t) const {
  return at(alpha_, t, x) * x + at(sigma_, t, x) * noise;
}

Tensor LinearSchedule::velocity(const Tensor& x, const Tensor& noise, const Tensor& t) const {
  return at(alpha_, t, x) * noise - at(sigma_, t, x) * x;
}

Tensor LinearSchedule::clean(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const {
  return at(alpha_, t, noisy) * noisy - at(sigma_, t, noisy) * velocity;
}

Tensor LinearSchedule::noise(const Tensor& noisy, const Tensor& velocity, const Tensor& t) const {
  return at(sigma_, t, noisy) * noisy + at(alpha_, t, noisy) * velocity;
}

}  // namespace cloam
