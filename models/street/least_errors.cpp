// See least_errors.h.
#include "models/street/least_errors.h"

#include "runtime/ops.h"

namespace cloam {

Tensor mean_of_least(const Tensor& errors, int64_t kept) {
  const Tensor limit = slice(sort(stop_gradient(errors)).keys, 0, kept - 1, kept);
  return sum(where(errors <= limit, errors, 0.f)) * (1.f / static_cast<float>(kept));
}

}  // namespace cloam
