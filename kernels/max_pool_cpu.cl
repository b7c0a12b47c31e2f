// Pooling where a work-item is a core's loop: BLOCK windows of a row side by side, first the largest of each column, then
// the largest of each window's columns. Both loops vectorise. A piece is a plane: no two work-items add into one place.
// PLACES 0: values alone are wanted (`of` is x).
//: variant max_pool2d_planes cpu any BLOCK=64
#define COLUMNS ((BLOCK - 1) * STRIDE + WINDOW)
typedef struct {
  float best[COLUMNS];
  int place[COLUMNS];  // in the plane
} Columns;
typedef struct {
  float best[BLOCK];
  int place[BLOCK];
} Windows;

// The largest values of the columns that `count` windows of row p from window q on see. Columns outside the image lose to
// all others.
INLINE void find_in_columns(__global const float* plane, int H, int W, int p, int q, int count, Columns* found) {
  const int left = q * STRIDE - PAD, top = max(p * STRIDE - PAD, 0), bottom = min(p * STRIDE - PAD + WINDOW, H);
  const int columns = (count - 1) * STRIDE + WINDOW, begin = max(-left, 0), end = min(columns, W - left);
  for (int c = 0; c < columns; c++) {
    found->best[c] = -INFINITY;
    found->place[c] = INT_MAX;
  }
  for (int c = begin; c < end; c++) {
    found->best[c] = plane[top * W + left + c];
    found->place[c] = top * W + left + c;
  }
  for (int y = top + 1; y < bottom; y++)
    for (int c = begin; c < end; c++) {
      const float value = plane[y * W + left + c], best = found->best[c];
      const int beats = (value > best) | ((value != value) & (best == best));
      found->best[c] = beats ? value : best;
      if (PLACES) found->place[c] = beats ? y * W + left + c : found->place[c];
    }
}

INLINE void find(__global const float* plane, int H, int W, int p, int q, int count, Windows* found) {
  Columns of;
  find_in_columns(plane, H, W, p, q, count, &of);
  for (int i = 0; i < count; i++) {
    float best = of.best[i * STRIDE];
    int place = of.place[i * STRIDE];
    UNROLL for (int tap = 1; tap < WINDOW; tap++) {
      const float value = of.best[i * STRIDE + tap];
      const int at = of.place[i * STRIDE + tap], nan = value != value;
      const int first = PLACES ? ((value == best) | nan) & (at < place) : 0;  // row by row, not column by column
      const int beats = (value > best) | (nan & (best == best)) | first;
      best = beats ? value : best;
      place = beats ? at : place;
    }
    found->best[i] = best;
    found->place[i] = place;
  }
}

__kernel FAT void max_pool2d_planes(__global const float* restrict x, __global const float* restrict of,
                                    __global float* restrict out, int pieces, int H, int W, int P, int Q, int chunk) {
  Windows found;
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece++) {
    __global const float* values = of + (size_t)piece * H * W;
    __global float* to = out + (size_t)piece * P * Q;
    for (int p = 0; p < P; p++)
      for (int q = 0; q < Q; q += BLOCK) {
        const int count = min(BLOCK, Q - q);
        find(x + (size_t)piece * H * W, H, W, p, q, count, &found);
        for (int i = 0; i < count; i++) to[p * Q + q + i] = PLACES ? values[found.place[i]] : found.best[i];
      }
  }
}

__kernel FAT void max_pool2d_spread_planes(__global const float* restrict x, __global const float* restrict g,
                                           __global float* restrict out, int pieces, int H, int W, int P, int Q,
                                           int chunk) {
  Windows found;
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
