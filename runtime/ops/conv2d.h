// Private: what the files of conv2d share.
#pragma once
#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/ceil_div.h"

namespace cloam {

inline int64_t round_up(int64_t a, int64_t b) { return ceil_div(a, b) * b; }

/// x [N,C,H,W], w [K,C/groups,R,S], y [N,K,P,Q].
struct ConvSizes {
  int64_t N, C, H, W, K, R, S, P, Q;
  Conv2dParams with;
  int64_t channels() const { return C / with.groups; }  // of one group
  int64_t filters() const { return K / with.groups; }
  double flops() const { return 2.0 * static_cast<double>(N * K * P * Q) * static_cast<double>(channels() * R * S); }
  bool empty() const { return N * C * H * W * K * P * Q * R * S == 0; }
};

/// The forward pass and the adjoint in x, seen as one thing: a convolution of `in` (its elements `dilation` apart).
struct ConvPass {
  int64_t images, groups, inputs, in_height, in_width, outputs, out_height, out_width, R, S, stride, dilation, pad_y,
      pad_x;
  bool flip;
};
ConvPass forward_pass(const ConvSizes& z);
ConvPass backward_pass(const ConvSizes& z);

/// in: the image, w, then what the epilogue's flags (epilogue.h) say; or x, y. False: no variant for these sizes.
bool run_conv2d_cpu(const ConvSizes& sizes, const ConvPass& pass, int epilogue, const Tensors& in, const Tensor& out);
bool run_conv2d_dw_cpu(const ConvSizes& sizes, const Tensors& in, const Tensor& out);
void run_conv2d_gpu(const ConvSizes& sizes, int epilogue, const Tensors& in, const Tensor& out);
void run_conv2d_dx_gpu(const ConvSizes& sizes, const Tensors& in, const Tensor& out);
void run_conv2d_dw_gpu(const ConvSizes& sizes, const Tensors& in, const Tensor& out);

}  // namespace cloam
