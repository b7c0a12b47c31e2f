// See code_rows.h.
#include "models/latents/code_rows.h"

#include "runtime/ops.h"

namespace cloam {

void CodeRows::write(const std::vector<float>& codes) const {
  const auto width = static_cast<size_t>(own.dim(1));
  std::vector<float> all = own.to_host();
  const size_t numbers = codes.size() / rows.size();
  for (size_t row = 0; row < rows.size(); ++row)
    for (size_t i = 0; i < numbers; ++i) all[static_cast<size_t>(rows[row]) * width + i] = codes[row * numbers + i];
  assign({{own, from_host(all, own.shape())}});
}

Tensor CodeRows::take_gradient(Step& rendering, const Tensors& wanted, int64_t numbers) const {
  Tensor of_rows;
  for (size_t i = 0; i < wanted.size(); ++i) {
    Tensor& by = rendering.gradients[i];
    if (by && wanted[i].node() == own.node()) {
      const auto count = static_cast<int64_t>(rows.size());
      of_rows = slice(gather_rows(by, from_host(rows, {count})), 1, 0, numbers);
    }
    if (wanted[i].node() == own.node()) by = Tensor();
  }
  return of_rows;
}

}  // namespace cloam
