// Layers: weights [in, out] declared under a scope, applied to rows [S, in].
#pragma once
#include <vector>

#include "models/nn/params.h"

namespace cloam {

/// y = x W + b. Initial weights uniform in +-sqrt(6 / in) (He), bias zero.
struct Linear {
  Linear(const Scope& scope, int64_t in, int64_t out);
  Tensor operator()(const Tensor& x) const;
  Tensor weight, bias;
};

/// Small fused perceptron without biases (ops.h: mlp): sizes in, hidden ..., out.
struct SmallMlp {
  SmallMlp(const Scope& scope, const std::vector<int64_t>& sizes);
  Tensor operator()(const Tensor& x) const;
  Tensors weights;
};

/// NeRF's encoding gamma (Mildenhall et al. 2020, eq. 4): identity, then sin and cos at 2^0 ... 2^(count-1), no factor
/// pi. x [S, C] -> [S, C * (1 + 2 count)].
Tensor frequency_encoding(const Tensor& x, int count);

}  // namespace cloam
