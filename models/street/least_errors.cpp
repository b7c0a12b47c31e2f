// See least_errors.h.
#include "models/street/least_errors.h"

#include <algorithm>
#include <cmath>

#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr double kKept = 0.95;  // share

}  // namespace

Tensor mean_of_least(const Tensor& errors, int64_t kept) {
  const Tensor limit = slice(sort(stop_gradient(errors)).keys, 0, kept - 1, kept);
  return sum(where(errors <= limit, errors, 0.f)) * (1.f / static_cast<float>(kept));
}

Tensor mean_without_worst(const Tensor& errors) {
  return mean_of_least(errors, std::max<int64_t>(1, std::llround(kKept * static_cast<double>(errors.dim(0)))));
}

}  // namespace cloam
