// See method.h.
#include "models/train/method.h"

#include <cmath>

#include "runtime/ops.h"

namespace cloam {

MemoryPlan memory_of(const Params& parameters) {
  MemoryPlan plan;
  for (const auto& [name, p] : parameters) plan.parameters += static_cast<uint64_t>(p.numel()) * 4;
  plan.optimiser = 2 * plan.parameters;
  return plan;
}

double Figure::value() const {
  if (!pending) return number;
  const auto scalar = static_cast<double>(pending.item());
  return squared_error ? -10 * std::log10(scalar + 1e-12) : scalar;
}

Figure psnr_figure(const Tensor& mean_squared_error) { return {"psnr", 0, mean_squared_error, true}; }

Step step_of(const Tensor& loss, const Tensors& wanted) { return {loss, grad_where_reached(loss, wanted)}; }

}  // namespace cloam
