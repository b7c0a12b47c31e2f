// Adjoint of conv2d.cl in w. version 1: a work-item is an element of the result.
//: variant conv2d_dw reference any
__kernel void conv2d_dw(__global const float* restrict x, __global const float* restrict y, __global float* restrict w,
                        int N, int C, int H, int W, int K, int R, int S, int P, int Q, int stride, int pad,
                        int groups) {
  const int channels = C / groups, element = get_global_id(0);
  if (element >= channels * R * S) return;
  const int k = get_global_id(1), c = element / (R * S), r = element / S - c * R, s = element % S;
  const int channel = k / (K / groups) * channels + c;
  float sum = 0.0f;
  for (int n = 0; n < N; n++)
    for (int p = 0; p < P; p++) {
      const int row = p * stride + r - pad;
      if (row < 0 || row >= H) continue;
      __global const float* from = x + (((size_t)n * C + channel) * H + row) * W;
      __global const float* g = y + (((size_t)n * K + k) * P + p) * Q;
      for (int q = 0; q < Q; q++) {
        const int column = q * stride + s - pad;
        if (column >= 0 && column < W) sum += from[column] * g[q];
      }
    }
  w[(size_t)k * channels * R * S + element] = sum;
}
