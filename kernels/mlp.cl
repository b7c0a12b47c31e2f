// Fused multilayer perceptron: x [n, IN] -> [n, OUT], HIDDEN layers of WIDTH with ReLU, linear output, no biases.
// Weights packed as [IN][WIDTH], (HIDDEN - 1) x [WIDTH][WIDTH], [WIDTH][OUT].
// version 1 is the composition of matmuls in runtime/ops/mlp.cpp; version 2 (here) is for CPU devices: a work-item takes
// blocks of BLOCK samples through all layers, activations stay in its scratch, register tiles of 4 x 64.
#define BLOCK 64
#define UNROLL4 _Pragma("unroll 4")
#define PAD16(n) (((n) + 15) / 16 * 16)
#define IN_PAD PAD16(IN)
#define OUT_PAD PAD16(OUT)
#define W_HIDDEN (IN * WIDTH)
#define W_OUT (W_HIDDEN + (HIDDEN - 1) * WIDTH * WIDTH)
#define W_ALL (W_OUT + WIDTH * OUT)

// Register tile for a row of COLS columns: ROWS x VECTORS accumulators of 16 floats.
#define TILE_VECTORS(cols) ((cols) % 64 == 0 ? 4 : (cols) % 32 == 0 ? 2 : 1)
#define TILE_ROWS(cols) ((cols) % 64 == 0 ? 4 : 8)

// out[s][o] = sum_k in[s][k] * w[k][o], s < BLOCK; STORE sees value, s + i, o + 16 * v.
#define LAYER(NAME, IN_SPACE, W_SPACE, COLS, VECTORS, ROWS, EPILOGUE)                                                 \
  inline void NAME(IN_SPACE const float* restrict in, int stride, int depth, W_SPACE const float* restrict w,         \
                   __local float* restrict out, __global const float* restrict gate) {                               \
    for (int o = 0; o < COLS; o += 16 * VECTORS)                                                                      \
      for (int s = 0; s < BLOCK; s += ROWS) {                                                                         \
        float16 acc[ROWS][VECTORS];                                                                                   \
        UNROLL for (int i = 0; i < ROWS; i++) UNROLL for (int v = 0; v < VECTORS; v++) acc[i][v] = (float16)(0);      \
        UNROLL4 for (int k = 0; k < depth; k++) {                                                                     \
          float16 b[VECTORS];                                                                                         \
          UNROLL for (int v = 0; v < VECTORS; v++) b[v] = vload16(v, w + k * COLS + o);                               \
          UNROLL for (int i = 0; i < ROWS; i++) {                                                                     \
            const float16 a = (float16)(in[(s + i) * stride + k]);                                                    \
            UNROLL for (int v = 0; v < VECTORS; v++) acc[i][v] += a * b[v];                                           \
          }                                                                                                           \
        }                                                                                                             \
        UNROLL for (int i = 0; i < ROWS; i++) UNROLL for (int v = 0; v < VECTORS; v++) {                              \
          float16 value = acc[i][v];                                                                                  \
          const int at = (s + i) * COLS + o + 16 * v;                                                                 \
          EPILOGUE                                                                                                    \
          vstore16(value, 0, out + at);                                                                               \
        }                                                                                                             \
      }                                                                                                               \
  }

#define RELU value = fmax(value, (float16)(0));
#define GATED value = select((float16)(0), value, vload16(0, gate + at) > (float16)(0));
#define PLAIN

LAYER(layer_hidden, __local, __global, WIDTH, TILE_VECTORS(WIDTH), TILE_ROWS(WIDTH), RELU)
LAYER(layer_out, __local, __local, OUT_PAD, TILE_VECTORS(OUT_PAD), TILE_ROWS(OUT_PAD), PLAIN)
LAYER(grad_hidden, __local, __local, WIDTH, TILE_VECTORS(WIDTH), TILE_ROWS(WIDTH), GATED)
LAYER(grad_in, __local, __local, IN_PAD, TILE_VECTORS(IN_PAD), TILE_ROWS(IN_PAD), PLAIN)

// dw[k][o] += sum_s a[s][k] * dz[s][o], rows k < DEPTH (a multiple of ROWS).
#define WEIGHT_GRAD(NAME, A_SPACE, COLS, VECTORS, ROWS)                                                               \
  inline void NAME(A_SPACE const float* restrict a, int stride, int depth, __local const float* restrict dz,          \
                   __local float* restrict dw) {                                                                     \
    for (int o = 0; o < COLS; o += 16 * VECTORS)                                                                      \
      for (int k = 0; k < depth; k += ROWS) {                                                                         \
        float16 acc[ROWS][VECTORS];                                                                                   \
        UNROLL for (int i = 0; i < ROWS; i++) UNROLL for (int v = 0; v < VECTORS; v++)                                \
            acc[i][v] = vload16(v, dw + (k + i) * COLS + o);                                                          \
        UNROLL4 for (int s = 0; s < BLOCK; s++) {                                                                     \
          float16 b[VECTORS];                                                                                         \
          UNROLL for (int v = 0; v < VECTORS; v++) b[v] = vload16(v, dz + s * COLS + o);                              \
          UNROLL for (int i = 0; i < ROWS; i++) {                                                                     \
            const float16 value = (float16)(a[s * stride + k + i]);                                                   \
            UNROLL for (int v = 0; v < VECTORS; v++) acc[i][v] += value * b[v];                                       \
          }                                                                                                           \
        }                                                                                                             \
        UNROLL for (int i = 0; i < ROWS; i++) UNROLL for (int v = 0; v < VECTORS; v++)                                \
            vstore16(acc[i][v], v, dw + (k + i) * COLS + o);                                                          \
      }                                                                                                               \
  }
WEIGHT_GRAD(weight_grad_in, __local, WIDTH, TILE_VECTORS(WIDTH), TILE_ROWS(WIDTH))
WEIGHT_GRAD(weight_grad_hidden, __global, WIDTH, TILE_VECTORS(WIDTH), TILE_ROWS(WIDTH))
WEIGHT_GRAD(weight_grad_out, __global, OUT_PAD, TILE_VECTORS(OUT_PAD), TILE_ROWS(OUT_PAD))

// Rows [first, first + BLOCK) of x [n, cols] into a block of padded rows, zeros beyond. Copies of whole rows are
// vectors: element by element they would take as long as the layer itself.
inline void load_block(__global const float* restrict x, int first, int n, int cols, int padded, __local float* restrict to) {
  const int rows = min(BLOCK, n - first);
  if (cols == padded) {
    for (int i = 0; i < rows * cols; i += 16) vstore16(vload16(0, x + (size_t)first * cols + i), 0, to + i);
  } else {
    for (int s = 0; s < rows; s++) {
      for (int i = 0; i < cols; i++) to[s * padded + i] = x[(size_t)(first + s) * cols + i];
      for (int i = cols; i < padded; i++) to[s * padded + i] = 0.0f;
    }
  }
  for (int i = max(rows, 0) * padded; i < BLOCK * padded; i++) to[i] = 0.0f;
}
inline void store_block(__local const float* restrict from, int first, int n, int cols, int padded, __global float* restrict y) {
  const int rows = min(BLOCK, n - first);
  if (cols == padded) {
    for (int i = 0; i < rows * cols; i += 16) vstore16(vload16(0, from + i), 0, y + (size_t)first * cols + i);
    return;
  }
  for (int s = 0; s < rows; s++)
    for (int i = 0; i < cols; i++) y[(size_t)(first + s) * cols + i] = from[s * padded + i];
}

// hidden: [HIDDEN][padded rows][WIDTH], written when keep is 1 (training); rows beyond n come out zero.
FAT __kernel void mlp_forward(__global const float* restrict x, __global const float* restrict w, __global float* restrict y,
                              __global float* restrict hidden, int n, int padded_n, int per_item, int keep) {
  __local float a[BLOCK * (IN_PAD > WIDTH ? IN_PAD : WIDTH)] __attribute__((aligned(64)));
  __local float b[BLOCK * (OUT_PAD > WIDTH ? OUT_PAD : WIDTH)] __attribute__((aligned(64)));
  __local float w_out[WIDTH * OUT_PAD] __attribute__((aligned(64)));
  for (int k = 0; k < WIDTH; k++)
    for (int o = 0; o < OUT_PAD; o++) w_out[k * OUT_PAD + o] = o < OUT ? w[W_OUT + k * OUT + o] : 0.0f;
  const int end = min(padded_n, ((int)get_global_id(0) + 1) * per_item);
  for (int first = get_global_id(0) * per_item; first < end; first += BLOCK) {
    load_block(x, first, n, IN, IN_PAD, a);
    __local float* from = a;
    __local float* to = b;
    for (int layer = 0; layer < HIDDEN; layer++) {
      if (layer == 0) layer_hidden(from, IN_PAD, IN, w, to, 0);
      else layer_hidden(from, WIDTH, WIDTH, w + W_HIDDEN + (layer - 1) * WIDTH * WIDTH, to, 0);
      if (keep) {
        __global float* h = hidden + ((size_t)layer * padded_n + first) * WIDTH;
        for (int i = 0; i < BLOCK * WIDTH; i += 16) vstore16(vload16(0, to + i), 0, h + i);
      }
      __local float* swap = from;
      from = to;
      to = swap;
    }
    layer_out(from, WIDTH, WIDTH, w_out, to, 0);
    store_block(to, first, n, OUT, OUT_PAD, y);
  }
}

// One work-item's share: dx [n, IN] rows, and its partial weight gradient (packed as w) into partial[item].
FAT __kernel void mlp_backward(__global const float* restrict x, __global const float* restrict w, __global const float* restrict hidden,
                               __global const float* restrict dy, __global float* restrict dx, __global float* restrict partial,
                               int n, int padded_n, int per_item) {
  __local float w_in_t[WIDTH * IN_PAD] __attribute__((aligned(64)));
  __local float w_hidden_t[(HIDDEN - 1) * WIDTH * WIDTH + 16] __attribute__((aligned(64)));
  __local float w_out_t[OUT_PAD * WIDTH] __attribute__((aligned(64)));
  __local float dw_in[IN_PAD * WIDTH] __attribute__((aligned(64)));
  __local float dw_hidden[(HIDDEN - 1) * WIDTH * WIDTH + 16] __attribute__((aligned(64)));
  __local float dw_out[WIDTH * OUT_PAD] __attribute__((aligned(64)));
  __local float block_x[BLOCK * IN_PAD] __attribute__((aligned(64)));
  __local float block_y[BLOCK * OUT_PAD] __attribute__((aligned(64)));
  __local float g0[BLOCK * (IN_PAD > WIDTH ? IN_PAD : WIDTH)] __attribute__((aligned(64)));
  __local float g1[BLOCK * (IN_PAD > WIDTH ? IN_PAD : WIDTH)] __attribute__((aligned(64)));

  for (int o = 0; o < WIDTH; o++)
    for (int i = 0; i < IN_PAD; i++) w_in_t[o * IN_PAD + i] = i < IN ? w[i * WIDTH + o] : 0.0f;
  for (int layer = 0; layer < HIDDEN - 1; layer++)
    for (int o = 0; o < WIDTH; o++)
      for (int i = 0; i < WIDTH; i++)
        w_hidden_t[(layer * WIDTH + o) * WIDTH + i] = w[W_HIDDEN + (layer * WIDTH + i) * WIDTH + o];
  for (int o = 0; o < OUT_PAD; o++)
    for (int i = 0; i < WIDTH; i++) w_out_t[o * WIDTH + i] = o < OUT ? w[W_OUT + i * OUT + o] : 0.0f;
  for (int i = 0; i < IN_PAD * WIDTH; i++) dw_in[i] = 0.0f;
  for (int i = 0; i < (HIDDEN - 1) * WIDTH * WIDTH; i++) dw_hidden[i] = 0.0f;
  for (int i = 0; i < WIDTH * OUT_PAD; i++) dw_out[i] = 0.0f;

  const int end = min(padded_n, ((int)get_global_id(0) + 1) * per_item);
  for (int first = get_global_id(0) * per_item; first < end; first += BLOCK) {
    load_block(x, first, n, IN, IN_PAD, block_x);
    load_block(dy, first, n, OUT, OUT_PAD, block_y);
    __global const float* h = hidden + ((size_t)(HIDDEN - 1) * padded_n + first) * WIDTH;
    weight_grad_out(h, WIDTH, WIDTH, block_y, dw_out);
    grad_hidden(block_y, OUT_PAD, OUT, w_out_t, g0, h);
    __local float* from = g0;
    __local float* to = g1;
    for (int layer = HIDDEN - 1; layer > 0; layer--) {
      h = hidden + ((size_t)(layer - 1) * padded_n + first) * WIDTH;
      weight_grad_hidden(h, WIDTH, WIDTH, from, dw_hidden + (layer - 1) * WIDTH * WIDTH);
      grad_hidden(from, WIDTH, WIDTH, w_hidden_t + (layer - 1) * WIDTH * WIDTH, to, h);
      __local float* swap = from;
      from = to;
      to = swap;
    }
    weight_grad_in(block_x, IN_PAD, IN_PAD, from, dw_in);
    grad_in(from, WIDTH, WIDTH, w_in_t, to, 0);
    store_block(to, first, n, IN, IN_PAD, dx);
  }
  __global float* p = partial + (size_t)get_global_id(0) * W_ALL;
  for (int i = 0; i < IN * WIDTH; i++) p[i] = dw_in[i];
  for (int i = 0; i < (HIDDEN - 1) * WIDTH * WIDTH; i++) p[W_HIDDEN + i] = dw_hidden[i];
  for (int k = 0; k < WIDTH; k++)
    for (int o = 0; o < OUT; o++) p[W_OUT + k * OUT + o] = dw_out[k * OUT_PAD + o];
}

// The work-items' shares added in their order.
FAT __kernel void mlp_reduce(__global const float* restrict partial, __global float* restrict dw, int begin, int count, int items, int per_item) {
  const int end = min(count, ((int)get_global_id(0) + 1) * per_item);
  for (int i = get_global_id(0) * per_item; i < end; i++) {
    float total = 0.0f;
    for (int g = 0; g < items; g++) total += partial[(size_t)g * count + i];
    dw[begin + i] = total;
  }
}
