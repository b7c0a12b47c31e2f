// Attention as a composition (Vaswani et al. 2017, equation 1).
#include <cmath>

#include "runtime/ops.h"

namespace cloam {

Tensor attention(const Tensor& q, const Tensor& k, const Tensor& v, float scale) {
  const Dims d = match("attention", {{"q", q, "B T D"}, {"k", k, "B U D"}, {"v", v, "B U E"}});
  const float by = scale > 0 ? scale : 1.f / std::sqrt(static_cast<float>(d["D"]));
  return matmul(softmax(matmul(q, transpose(k)) * by, -1), v);
}

}  // namespace cloam
