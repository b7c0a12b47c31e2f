// Pooling where a work-item is a core's loop: BLOCK windows of a row side by side, tap by tap, which vectorises. A piece is
// a plane: no two work-items add into one place.
//: variant max_pool2d_planes cpu any BLOCK=64
typedef struct {
  float best[BLOCK];
  int place[BLOCK];
} Found;

// The largest values of windows q, q + 1 ... q + count - 1 of row p, and their places in the plane.
INLINE void find(__global const float* plane, int H, int W, int p, int q, int count, Found* found) {
  const int top = p * STRIDE - PAD;
  for (int i = 0; i < count; i++) {
    found->best[i] = -INFINITY;
    found->place[i] = max(top, 0) * W + max((q + i) * STRIDE - PAD, 0);
  }
  for (int y = max(top, 0); y < min(top + WINDOW, H); y++)
    UNROLL for (int tap = 0; tap < WINDOW; tap++) {
      const int left = q * STRIDE - PAD + tap;  // of the first window's tap; windows whose tap is outside are left out
      const int begin = left < 0 ? (-left + STRIDE - 1) / STRIDE : 0;
      const int end = left < W ? min(count, (W - 1 - left) / STRIDE + 1) : 0;
      const int at = y * W + left;
      for (int i = begin; i < end; i++) {
        const float value = plane[at + i * STRIDE];
        const int beats = (value > found->best[i]) | (value != value);
        found->place[i] = beats ? at + i * STRIDE : found->place[i];
        found->best[i] = beats ? value : found->best[i];
      }
    }
}

__kernel FAT void max_pool2d_planes(__global const float* restrict x, __global const float* restrict of,
                                    __global float* restrict out, int pieces, int H, int W, int P, int Q, int chunk) {
  Found found;
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece++) {
    __global const float* values = of + (size_t)piece * H * W;
    __global float* to = out + (size_t)piece * P * Q;
    for (int p = 0; p < P; p++)
      for (int q = 0; q < Q; q += BLOCK) {
        const int count = min(BLOCK, Q - q);
        find(x + (size_t)piece * H * W, H, W, p, q, count, &found);
        for (int i = 0; i < count; i++) to[p * Q + q + i] = values[found.place[i]];
      }
  }
}

__kernel FAT void max_pool2d_spread_planes(__global const float* restrict x, __global const float* restrict g,
                                           __global float* restrict out, int pieces, int H, int W, int P, int Q,
                                           int chunk) {
  Found found;
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece++) {
    __global const float* from = g + (size_t)piece * P * Q;
    __global float* to = out + (size_t)piece * H * W;
    for (int i = 0; i < H * W; i++) to[i] = 0.0f;
    for (int p = 0; p < P; p++)
      for (int q = 0; q < Q; q += BLOCK) {
        const int count = min(BLOCK, Q - q);
        find(x + (size_t)piece * H * W, H, W, p, q, count, &found);
        for (int i = 0; i < count; i++) to[found.place[i]] += from[p * Q + q + i];
      }
  }
}
