// Layers: weights [in, out] declared under a scope, applied to rows [S, in].
#pragma once
#include <vector>

#include "models/nn/params.h"
#include "runtime/ops.h"

namespace cloam {

/// y = activation(x W + b), x [.., in]. Initial weights uniform in +-gain * sqrt(6 / in) (gain 1: He; 0: zeros), bias
/// zero.
struct Linear {
  Linear(const Scope& scope, int64_t in, int64_t out, float gain = 1.f);
  Tensor operator()(const Tensor& x, Activation activation = Activation::none) const;
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

/// The Transformer's encoding as DDPM uses it for diffusion times: sin then cos of t * 10000^(-i / (channels/2 - 1)).
/// t [N] float32, 0 to 1000 (below 8192, see ops.h: sin) -> [N, channels]; channels even, from 4.
Tensor timestep_encoding(const Tensor& t, int64_t channels);

}  // namespace cloam
