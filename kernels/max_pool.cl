// The largest value of each window of images [N,C,H,W], seen as N*C planes; what lies outside the image is not looked at.
// A NaN in a window is its largest value. Of equal ones the first, row by row, is the one meant, here and in
// max_pool_cpu.cl.
//   max_pool2d:        out[i,p,q] = of[i] at the place of the largest of x[i] in window (p,q); `of` is x, or as large
//   max_pool2d_spread: the adjoint in `of`: every g[i,p,q] added to out[i] at that place
// version 1. A value a work-item; the adjoint looks at all windows that a pixel is in.
//: variant max_pool2d reference any
#define BEATS(value, best) ((value) > (best) || ((value) != (value) && (best) == (best)))

// The place in a plane of the largest value of the window that begins at (top, left).
static inline int largest_place(__global const float* plane, int H, int W, int top, int left) {
  int place = max(top, 0) * W + max(left, 0);
  float best = -INFINITY;
  for (int y = max(top, 0); y < min(top + WINDOW, H); y++)
    for (int x = max(left, 0); x < min(left + WINDOW, W); x++) {
      const float value = plane[y * W + x];
      place = BEATS(value, best) ? y * W + x : place;
      best = BEATS(value, best) ? value : best;
    }
  return place;
}

__kernel void max_pool2d(__global const float* x, __global const float* of, __global float* out, int count, int H, int W,
                         int P, int Q) {
  const int i = get_global_id(0);
  if (i >= count) return;
  const int q = i % Q, p = i / Q % P;
  const size_t plane = (size_t)(i / (P * Q)) * H * W;
  out[i] = of[plane + largest_place(x + plane, H, W, p * STRIDE - PAD, q * STRIDE - PAD)];
}

__kernel void max_pool2d_spread(__global const float* x, __global const float* g, __global float* out, int count, int H,
                                int W, int P, int Q) {
  const int i = get_global_id(0);
  if (i >= count) return;
  const int column = i % W, row = i / W % H, plane = i / (H * W);
  const int top = row + PAD - WINDOW + 1, left = column + PAD - WINDOW + 1;  // of the first window to hold this pixel
  float sum = 0.0f;
  for (int p = top > 0 ? (top + STRIDE - 1) / STRIDE : 0; p < min(P, (row + PAD) / STRIDE + 1); p++)
    for (int q = left > 0 ? (left + STRIDE - 1) / STRIDE : 0; q < min(Q, (column + PAD) / STRIDE + 1); q++) {
      const int place = largest_place(x + (size_t)plane * H * W, H, W, p * STRIDE - PAD, q * STRIDE - PAD);
      sum += place == row * W + column ? g[(plane * P + p) * Q + q] : 0.0f;
    }
  out[i] = sum;
}
