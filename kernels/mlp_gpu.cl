// Fused multilayer perceptron for GPU devices, with the weights as in kernels/mlp.cl. A group of 64 takes TILE samples
// through all layers: their activations lie in local memory, samples side by side, and weights pass through it DEPTH rows
// at a time. A work-item holds 4 samples of every eighth column. Local memory: 4 (128 TILE + 128 DEPTH) bytes at most.
// The weights' gradients are products over all samples, which runtime/ops/mlp.cpp leaves to matmul.
//: variant mlp_forward gpu any TILE=32 DEPTH=16
#define LANES 64
#define W_HIDDEN (IN * WIDTH)
#define W_OUT (W_HIDDEN + (HIDDEN - 1) * WIDTH * WIDTH)
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define WIDEST LARGER(WIDTH, LARGER(IN, OUT))
#define EIGHTHS(columns) (((columns) + 7) / 8)

// acts [columns][TILE] of rows [first, first + TILE) of from [n][columns], zeros beyond n.
static inline void load_tile(__global const float* from, int columns, int first, int n, __local float* acts) {
  for (int e = get_local_id(0); e < TILE * columns; e += LANES) {
    const int s = e / columns, c = e % columns;
    acts[c * TILE + s] = first + s < n ? from[(size_t)(first + s) * columns + c] : 0.0f;
  }
}
static inline void store_tile(__local const float* acts, int columns, int first, int n, __global float* to) {
  for (int e = get_local_id(0); e < TILE * columns; e += LANES) {
    const int s = e / columns, c = e % columns;
    if (first + s < n) to[(size_t)(first + s) * columns + c] = acts[c * TILE + s];
  }
}

// weights [depth][columns], turned: [columns][depth].
typedef struct {
  __global const float* at;
  int depth, columns, turned;
} Weights;

// Rows [begin, begin + DEPTH) into rows [DEPTH][pitch], zeros where there are none.
static inline void load_weights(Weights w, int begin, int pitch, __local float* rows) {
  for (int e = get_local_id(0); e < DEPTH * pitch; e += LANES) {
    const int k = w.turned ? e % DEPTH : e / pitch, c = w.turned ? e / DEPTH : e % pitch, row = begin + k;
    const int place = w.turned ? c * w.depth + row : row * w.columns + c;
    rows[k * pitch + c] = row < w.depth && c < w.columns ? w.at[place] : 0.0f;
  }
}

// NAME(acts, w, rows): acts [depth][TILE] becomes [COLUMNS][TILE], the product with w; `rows` is room for weights. All
// work-items have finished with acts when it returns.
#define DEFINE_LAYER(NAME, COLUMNS)                                                                        \
  static inline void NAME(__local float* acts, Weights w, __local float* rows) {                           \
    const int column = get_local_id(0) % 8, sample = get_local_id(0) / 8 * 4;                              \
    float4 acc[EIGHTHS(COLUMNS)];                                                                          \
    UNROLL for (int j = 0; j < EIGHTHS(COLUMNS); j++) acc[j] = (float4)(0.0f);                             \
    for (int begin = 0; begin < w.depth; begin += DEPTH) {                                                 \
      barrier(CLK_LOCAL_MEM_FENCE);                                                                        \
      load_weights(w, begin, 8 * EIGHTHS(COLUMNS), rows);                                                  \
      barrier(CLK_LOCAL_MEM_FENCE);                                                                        \
      const int count = min(DEPTH, w.depth - begin);                                                       \
      for (int k = 0; k < count; k++) {                                                                    \
        const float4 a = vload4(0, acts + (begin + k) * TILE + sample);                                    \
        UNROLL for (int j = 0; j < EIGHTHS(COLUMNS); j++)                                                  \
            acc[j] += a * rows[(k * EIGHTHS(COLUMNS) + j) * 8 + column];                                   \
      }                                                                                                    \
    }                                                                                                      \
    barrier(CLK_LOCAL_MEM_FENCE);                                                                          \
    UNROLL for (int j = 0; j < EIGHTHS(COLUMNS); j++)                                                      \
        if (8 * j + column < COLUMNS) vstore4(acc[j], 0, acts + (8 * j + column) * TILE + sample);         \
    barrier(CLK_LOCAL_MEM_FENCE);                                                                          \
  }
DEFINE_LAYER(to_hidden, WIDTH)
DEFINE_LAYER(to_out, OUT)
DEFINE_LAYER(to_in, IN)

// hidden [HIDDEN][n][WIDTH]: written with keep.
__attribute__((reqd_work_group_size(LANES, 1, 1)))
__kernel void mlp_forward(__global const float* restrict x, __global const float* restrict w, __global float* restrict y,
                          __global float* restrict hidden, int n, int keep) {
  __local float acts[WIDEST * TILE], rows[DEPTH * 8 * EIGHTHS(WIDEST)];
  const int first = get_group_id(0) * TILE;
  load_tile(x, IN, first, n, acts);
  for (int layer = 0; layer < HIDDEN; layer++) {
    const Weights from_x = {w, IN, WIDTH, 0}, between = {w + W_HIDDEN + (layer - 1) * WIDTH * WIDTH, WIDTH, WIDTH, 0};
    to_hidden(acts, layer ? between : from_x, rows);
    for (int e = get_local_id(0); e < WIDTH * TILE; e += LANES) acts[e] = fmax(acts[e], 0.0f);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (keep) store_tile(acts, WIDTH, first, n, hidden + (size_t)layer * n * WIDTH);
  }
  const Weights to_y = {w + W_OUT, WIDTH, OUT, 0};
  to_out(acts, to_y, rows);
  store_tile(acts, OUT, first, n, y);
}

// d loss / d each layer's sums: dz [HIDDEN][n][WIDTH], and dx [n, IN], from dy [n, OUT].
__attribute__((reqd_work_group_size(LANES, 1, 1)))
__kernel void mlp_backward(__global const float* restrict w, __global const float* restrict hidden, __global const float* restrict dy,
                           __global float* restrict dx, __global float* restrict dz, int n) {
  __local float acts[WIDEST * TILE], rows[DEPTH * 8 * EIGHTHS(WIDEST)];
  const int first = get_group_id(0) * TILE;
  load_tile(dy, OUT, first, n, acts);
  for (int layer = HIDDEN - 1; layer >= 0; layer--) {
    const Weights from_y = {w + W_OUT, OUT, WIDTH, 1}, between = {w + W_HIDDEN + layer * WIDTH * WIDTH, WIDTH, WIDTH, 1};
    to_hidden(acts, layer == HIDDEN - 1 ? from_y : between, rows);
    const size_t at = (size_t)layer * n * WIDTH;
    for (int e = get_local_id(0); e < WIDTH * TILE; e += LANES) {
      const int s = e / WIDTH, c = e % WIDTH;
      const int open = first + s < n && hidden[at + (size_t)min(first + s, n - 1) * WIDTH + c] > 0.0f;
      acts[c * TILE + s] = open ? acts[c * TILE + s] : 0.0f;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    store_tile(acts, WIDTH, first, n, dz + at);
  }
  const Weights to_x = {w, WIDTH, IN, 1};
  to_in(acts, to_x, rows);
  store_tile(acts, IN, first, n, dx);
}
