// Two-dimensional convolution (correlation, as networks mean it) and its adjoint in x; any stride, padding and groups.
//   y[n,k,p,q] = sum over c, r, s of x[n, c, p * stride + r - pad, q * stride + s - pad] * w[k, c, r, s]
// version 1: a work-item is an element of the result.
//: variant conv2d reference any
// Channels C and K count all groups; x [N,C,H,W], w [K,C/groups,R,S], y [N,K,P,Q].

__kernel void conv2d(__global const float* restrict x, __global const float* restrict w, __global float* restrict y,
                     int C, int H, int W, int K, int R, int S, int P, int Q, int stride, int pad, int groups) {
  const int pixel = get_global_id(0);
  if (pixel >= P * Q) return;
  const int n = get_global_id(1) / K, k = get_global_id(1) - n * K, p = pixel / Q, q = pixel - p * Q;
  const int channels = C / groups, first = k / (K / groups) * channels;
  float sum = 0.0f;
  for (int c = 0; c < channels; c++)
    for (int r = 0; r < R; r++) {
      const int row = p * stride + r - pad;
      if (row < 0 || row >= H) continue;
      __global const float* from = x + (((size_t)n * C + first + c) * H + row) * W;
      for (int s = 0; s < S; s++) {
        const int column = q * stride + s - pad;
        if (column >= 0 && column < W) sum += from[column] * w[(((size_t)k * channels + c) * R + r) * S + s];
      }
    }
  y[((size_t)n * K + k) * P * Q + pixel] = sum;
}

__kernel void conv2d_dx(__global const float* restrict y, __global const float* restrict w, __global float* restrict x,
                        int C, int H, int W, int K, int R, int S, int P, int Q, int stride, int pad, int groups) {
  const int pixel = get_global_id(0);
  if (pixel >= H * W) return;
  const int n = get_global_id(1) / C, c = get_global_id(1) - n * C, row = pixel / W, column = pixel - row * W;
  const int channels = C / groups, filters = K / groups, group = c / channels, first = group * filters;
  float sum = 0.0f;
  for (int k = first; k < first + filters; k++)
    for (int r = 0; r < R; r++) {
      const int p = (row + pad - r) / stride;
      if (row + pad - r < 0 || p * stride != row + pad - r || p >= P) continue;
      __global const float* from = y + (((size_t)n * K + k) * P + p) * Q;
      for (int s = 0; s < S; s++) {
        const int q = (column + pad - s) / stride;
        const int hit = column + pad - s >= 0 && q * stride == column + pad - s && q < Q;
        if (hit) sum += from[q] * w[(((size_t)k * channels + c - group * channels) * R + r) * S + s];
      }
    }
  x[((size_t)n * C + c) * H * W + pixel] = sum;
}

// The end of a forward pass, in place: y = activation(y + bias + residual).
__kernel void conv2d_end(__global float* restrict y, __global const float* restrict bias,
                         __global const float* restrict residual, int K, int plane, int bias_step, int epilogue) {
  const int pixel = get_global_id(0);
  if (pixel >= plane) return;
  const int n = get_global_id(1) / K, k = get_global_id(1) - n * K;
  const size_t at = (size_t)get_global_id(1) * plane + pixel;
  float sum = y[at];
  if (epilogue & EPILOGUE_BIAS) sum += bias[n * bias_step + k];
  if (epilogue & EPILOGUE_RESIDUAL) sum += residual[at];
  y[at] = activate(sum, epilogue);
}

// An image of halves for the kernels that read floats: all but those of GPUs.
__kernel FAT void widen(__global const half* restrict from, __global float* restrict to, int count, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) to[i] = vload_half(i, from);
}
