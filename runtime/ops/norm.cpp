// Softmax and normalisations, all of them compositions: fusion makes a few passes of each.
#include <algorithm>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

/// x less its largest value along the axis: no exponential of it overflows, and the softmax is the same.
Tensor below_largest(const Tensor& x, int axis) { return x - stop_gradient(max(x, {{axis}, true})); }

/// Mean 0 and variance 1 along the last axis.
Tensor standardised(const Tensor& x, float epsilon) {
  const Tensor centred = x - mean(x, {{-1}, true});
  return centred * rsqrt(mean(square(centred), {{-1}, true}) + epsilon);
}

}  // namespace

Tensor softmax(const Tensor& x, int axis) {
  const int on = axis_of("softmax", x.rank(), axis);
  const Tensor e = exp(below_largest(x, on));
  return e / sum(e, {{on}, true});
}

Tensor log_softmax(const Tensor& x, int axis) {
  const int on = axis_of("log_softmax", x.rank(), axis);
  const Tensor shifted = below_largest(x, on);
  return shifted - log(sum(exp(shifted), {{on}, true}));
}

Tensor layer_norm(const Tensor& x, const Tensor& gamma, const Tensor& beta, float epsilon) {
  if (x.rank() == 0) throw Error(Fault::internal, "[layer_norm] x has no axis, want [..., C]");
  const Dims d = match("layer_norm", {{"gamma", gamma, "C"}, {"beta", beta, "C"}});
  if (d["C"] != x.dim(-1))
    throw Error(Fault::internal, text("[layer_norm] gamma has shape ", to_string(gamma.shape()), " for x ",
                                      to_string(x.shape()), ", want [", x.dim(-1), "]"));
  return standardised(x, epsilon) * gamma + beta;
}

Tensor group_norm(const Tensor& x, int groups, const Tensor& gamma, const Tensor& beta, float epsilon) {
  const Dims d = match("group_norm", {{"gamma", gamma, "C"}, {"beta", beta, "C"}});
  if (x.rank() < 2 || x.dim(1) != d["C"] || groups < 1 || d["C"] % groups != 0)
    throw Error(Fault::internal, text("[group_norm] x ", to_string(x.shape()), ", gamma ", to_string(gamma.shape()),
                                      ", ", groups, " groups: want x [N, C, ...], gamma [C], C a multiple of groups"));
  const Shape grouped = {x.dim(0), groups, x.numel() / std::max<int64_t>(1, x.dim(0) * groups)};
  const Tensor standard = reshape(standardised(reshape(x, grouped), epsilon), x.shape());
  Shape channels = Shape::filled(x.rank() - 1, 1);
  channels[0] = d["C"];
  return standard * reshape(gamma, channels) + reshape(beta, channels);
}

}  // namespace cloam
