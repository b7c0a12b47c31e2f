// Fused multilayer perceptron for CPU devices: x [n, IN] -> [n, OUT], HIDDEN layers of WIDTH (a multiple of 16) with ReLU,
// linear output, no biases. Weights one after another: [IN][WIDTH], (HIDDEN - 1) x [WIDTH][WIDTH], [WIDTH][OUT].
// A work-item takes blocks of BLOCK samples through all layers, so that activations come from its core's cache. A layer is
// register tiles of up to four vectors of 16 columns; ROWSv is the rows of a tile that is v vectors wide.
//
// Version 1 is the composition of matmuls in runtime/ops/mlp.cpp.
//: variant mlp_composed reference any
//: variant mlp_forward cpu any ROWS1=16 ROWS2=8 ROWS3=8 ROWS4=4 BLOCK=64
//: variant mlp_forward cpu any ROWS1=16 ROWS2=8 ROWS3=8 ROWS4=6 BLOCK=96
//: variant mlp_forward cpu any ROWS1=16 ROWS2=12 ROWS3=8 ROWS4=4 BLOCK=128
#define PAD16(n) (((n) + 15) / 16 * 16)
#define IN_PAD PAD16(IN)
#define OUT_PAD PAD16(OUT)
#define W_HIDDEN (IN * WIDTH)
#define W_OUT (W_HIDDEN + (HIDDEN - 1) * WIDTH * WIDTH)
#define W_ALL (W_OUT + WIDTH * OUT)
// Up to this many outputs are dot products along the vectors of a row: a tile of 16 columns would be mostly padding.
#define NARROW 4

// What mlp_pack makes of the weights: transposes for the gradient, rows padded to vectors, then the padded output layer.
#define T_OUT 0                                                  // [OUT][WIDTH]
#define T_HIDDEN (OUT * WIDTH)                                   // (HIDDEN - 1) x [WIDTH][WIDTH]
#define T_IN (T_HIDDEN + (HIDDEN - 1) * WIDTH * WIDTH)           // [WIDTH][IN_PAD]
#define PADDED_OUT (T_IN + WIDTH * IN_PAD)                       // [WIDTH][OUT_PAD]

#define UNROLL4 _Pragma("unroll 4")
// The widest tile that divides a row of so many columns. Tile sizes must be constants to the preprocessor: with any that
// only the optimiser finds out, accumulators stay in memory.
#define VECTORS(columns) ((columns) % 64 == 0 ? 4 : (columns) % 48 == 0 ? 3 : (columns) % 32 == 0 ? 2 : 1)
#define ROWS(columns) (VECTORS(columns) == 4 ? ROWS4 : VECTORS(columns) == 3 ? ROWS3 : VECTORS(columns) == 2 ? ROWS2 : ROWS1)

// The first `count` of the vector's numbers.
INLINE void store_some(float16 value, int count, __global float* to) {
  if (count >= 16) {
    store16(value, to);
    return;
  }
  if (count & 8) vstore8(value.lo, 0, to);
  const float8 rest8 = (count & 8) ? value.hi : value.lo;
  to += count & 8;
  if (count & 4) vstore4(rest8.lo, 0, to);
  const float4 rest4 = (count & 4) ? rest8.hi : rest8.lo;
  to += count & 4;
  if (count & 2) vstore2(rest4.lo, 0, to);
  if (count & 1) to[count & 2] = (count & 2) ? rest4.z : rest4.x;
}

enum Finish { PLAIN, RELU, GATED };
typedef struct {
  __global const float* in;  // [rows][depth]
  int depth;
  __global const float* weights;  // [depth][columns]
  __global float* out;            // [rows][stored], stored <= columns
  int stored;
  enum Finish finish;
  __global const float* gate;  // [rows][columns]: GATED keeps what lies where it is above 0, the derivative of ReLU
} Layer;

// NAME(l, rows): out = finish(in * weights). Rows of a tile beyond the last repeat it and are not stored.
#define DEFINE_LAYER(NAME, COLUMNS)                                                                                                     \
  INLINE void NAME(Layer l, int rows) {                                                                                                 \
    enum { V = VECTORS(COLUMNS), R = ROWS(COLUMNS) };                                                                                   \
    for (int o = 0; o < COLUMNS; o += 16 * V)                                                                                           \
      for (int s = 0; s < rows; s += R) {                                                                                               \
        float16 acc[R][V];                                                                                                              \
        __global const float* row[R];                                                                                                   \
        UNROLL for (int i = 0; i < R; i++) row[i] = l.in + min(s + i, rows - 1) * l.depth;                                              \
        UNROLL for (int i = 0; i < R; i++) UNROLL for (int v = 0; v < V; v++) acc[i][v] = (float16)(0);                                 \
        UNROLL4 for (int k = 0; k < l.depth; k++) {                                                                                     \
          float16 b[V];                                                                                                                 \
          UNROLL for (int v = 0; v < V; v++) b[v] = vload16(v, l.weights + k * COLUMNS + o);                                            \
          UNROLL for (int i = 0; i < R; i++) {                                                                                          \
            const float16 a = (float16)(row[i][k]);                                                                                     \
            UNROLL for (int v = 0; v < V; v++) acc[i][v] += a * b[v];                                                                   \
          }                                                                                                                             \
        }                                                                                                                               \
        UNROLL for (int i = 0; i < R; i++) if (s + i < rows) {                                                                          \
          UNROLL for (int v = 0; v < V; v++) {                                                                                          \
            const int column = o + 16 * v;                                                                                              \
            float16 value = acc[i][v];                                                                                                  \
            if (l.finish == RELU) value = fmax(value, (float16)(0));                                                                    \
            if (l.finish == GATED) value = select((float16)(0), value, vload16(0, l.gate + (s + i) * COLUMNS + column) > (float16)(0)); \
            store_some(value, l.stored - column, l.out + (s + i) * l.stored + column);                                                  \
          }                                                                                                                             \
        }                                                                                                                               \
      }                                                                                                                                 \
  }
DEFINE_LAYER(to_hidden, WIDTH)
DEFINE_LAYER(to_out, OUT_PAD)
DEFINE_LAYER(to_in, IN_PAD)

// out [rows][OUT] = in [rows][WIDTH] times the transpose of weights [OUT][WIDTH].
INLINE void run_narrow(__global const float* in, __global const float* weights, __global float* out, int rows) {
  for (int s = 0; s < rows; s++)
    UNROLL for (int o = 0; o < OUT; o++) {
      float16 acc = (float16)(0);
      UNROLL for (int v = 0; v < WIDTH / 16; v++) acc += vload16(v, in + s * WIDTH) * vload16(v, weights + o * WIDTH);
      out[s * OUT + o] = sum16(acc);
    }
}

// sum [depth][WIDTH] += transpose of a [rows][depth] times b [rows][WIDTH]; `fresh`: sum holds nothing yet.
INLINE void add_products(__global const float* a, int depth, __global const float* b, __global float* sum, int rows, int fresh) {
  enum { V = VECTORS(WIDTH), R = ROWS(WIDTH) };
  for (int o = 0; o < WIDTH; o += 16 * V)
    for (int k = 0; k < depth; k += R) {
      float16 acc[R][V];
      int column[R];
      UNROLL for (int i = 0; i < R; i++) column[i] = min(k + i, depth - 1);
      UNROLL for (int i = 0; i < R; i++) UNROLL for (int v = 0; v < V; v++)
          acc[i][v] = fresh ? (float16)(0) : vload16(v, sum + column[i] * WIDTH + o);
      UNROLL4 for (int s = 0; s < rows; s++) {
        float16 right[V];
        UNROLL for (int v = 0; v < V; v++) right[v] = vload16(v, b + s * WIDTH + o);
        UNROLL for (int i = 0; i < R; i++) {
          const float16 left = (float16)(a[s * depth + column[i]]);
          UNROLL for (int v = 0; v < V; v++) acc[i][v] += left * right[v];
        }
      }
      UNROLL for (int i = 0; i < R; i++) if (k + i < depth) {
        UNROLL for (int v = 0; v < V; v++) store16(acc[i][v], sum + (k + i) * WIDTH + o + 16 * v);
      }
    }
}

// to [columns][rows_padded]: the transpose of from [rows][columns], zeros beyond `rows`.
INLINE void transpose_matrix(__global const float* from, int rows, int columns, int rows_padded, __global float* to) {
  for (int c = 0; c < columns; c++)
    for (int r = 0; r < rows_padded; r++) to[c * rows_padded + r] = r < rows ? from[r * columns + c] : 0.0f;
}

// Items 0 and 1: the output layer padded and transposed; further ones, in training: the transposes of the other layers.
FAT __kernel void mlp_pack(__global const float* restrict w, __global float* restrict packed) {
  const int item = get_global_id(0), at = (item - 3) * WIDTH * WIDTH;
  if (item == 0)
    for (int k = 0; k < WIDTH; k++)
      for (int o = 0; o < OUT_PAD; o++) packed[PADDED_OUT + k * OUT_PAD + o] = o < OUT ? w[W_OUT + k * OUT + o] : 0.0f;
  if (item == 1) transpose_matrix(w + W_OUT, WIDTH, OUT, WIDTH, packed + T_OUT);
  if (item == 2) transpose_matrix(w, IN, WIDTH, IN_PAD, packed + T_IN);
  if (item > 2) transpose_matrix(w + W_HIDDEN + at, WIDTH, WIDTH, WIDTH, packed + T_HIDDEN + at);
}

// hidden: with keep [HIDDEN][n][WIDTH], the activations for the gradient; else [items][2][BLOCK][WIDTH] of scratch.
FAT __kernel void mlp_forward(__global const float* restrict x, __global const float* restrict w, __global const float* restrict packed,
                              __global float* restrict y, __global float* restrict hidden, int n, int per_item, int keep) {
  const int end = min(n, ((int)get_global_id(0) + 1) * per_item);
  for (int first = get_global_id(0) * per_item; first < end; first += BLOCK) {
    const int rows = min(BLOCK, end - first);
    __global float* h = keep ? hidden + (size_t)first * WIDTH : hidden + get_global_id(0) * (2 * BLOCK * WIDTH);
    Layer from_x = {x + (size_t)first * IN, IN, w, h, WIDTH, RELU, 0};
    to_hidden(from_x, rows);
    for (int layer = 1; layer < HIDDEN; layer++) {
      __global float* next = h + (keep ? (size_t)n * WIDTH : BLOCK * WIDTH * ((layer & 1) ? 1 : -1));
      Layer between = {h, WIDTH, w + W_HIDDEN + (layer - 1) * WIDTH * WIDTH, next, WIDTH, RELU, 0};
      to_hidden(between, rows);
      h = next;
    }
    __global float* to = y + (size_t)first * OUT;
    Layer to_y = {h, WIDTH, OUT == OUT_PAD ? w + W_OUT : packed + PADDED_OUT, to, OUT, PLAIN, 0};
    if (OUT <= NARROW) run_narrow(h, packed + T_OUT, to, rows);
    else to_out(to_y, rows);
  }
}

// One work-item's share: rows of dx [n, IN], and its part of the weight gradient in partial[item]: laid out as the weights,
// but the output layer's transposed. gradients: [items][2][BLOCK][WIDTH] of scratch.
FAT __kernel void mlp_backward(__global const float* restrict x, __global const float* restrict packed, __global const float* restrict hidden,
                               __global const float* restrict dy, __global float* restrict dx, __global float* restrict partial,
                               __global float* restrict gradients, int n, int per_item) {
  const int begin = get_global_id(0) * per_item, end = min(n, begin + per_item);
  __global float* sum = partial + (size_t)get_global_id(0) * W_ALL;
  for (int first = begin; first < end; first += BLOCK) {
    const int rows = min(BLOCK, end - first), fresh = first == begin;
    __global float* g = gradients + get_global_id(0) * (2 * BLOCK * WIDTH);
    __global const float* h = hidden + ((size_t)(HIDDEN - 1) * n + first) * WIDTH;
    __global const float* from = dy + (size_t)first * OUT;
    add_products(from, OUT, h, sum + W_OUT, rows, fresh);
    Layer from_y = {from, OUT, packed + T_OUT, g, WIDTH, GATED, h};
    to_hidden(from_y, rows);
    for (int layer = HIDDEN - 1; layer > 0; layer--) {
      const int at = (layer - 1) * WIDTH * WIDTH;
      __global float* next = gradients + (get_global_id(0) * 2 + ((HIDDEN - layer) & 1)) * (BLOCK * WIDTH);
      h -= (size_t)n * WIDTH;
      add_products(h, WIDTH, g, sum + W_HIDDEN + at, rows, fresh);
      Layer between = {g, WIDTH, packed + T_HIDDEN + at, next, WIDTH, GATED, h};
      to_hidden(between, rows);
      g = next;
    }
    add_products(x + (size_t)first * IN, IN, g, sum, rows, fresh);
    Layer to_x = {g, WIDTH, packed + T_IN, dx + (size_t)first * IN, IN, PLAIN, 0};
    to_in(to_x, rows);
  }
}

// dw: the items' parts added in their order, each row of WIDTH numbers by one work-item.
FAT __kernel void mlp_reduce(__global const float* restrict partial, __global float* restrict dw, int begin, int items) {
  const int row = get_global_id(0), o = row - W_OUT / WIDTH;
  for (int v = 0; v < WIDTH / 16; v++) {
    float16 total = (float16)(0);
    for (int g = 0; g < items; g++) total += vload16(v, partial + (size_t)g * W_ALL + row * WIDTH);
    if (o < 0) {
      store16(total, dw + begin + row * WIDTH + 16 * v);
    } else {
      float column[16];
      vstore16(total, 0, column);
      for (int i = 0; i < 16; i++) dw[begin + W_OUT + (16 * v + i) * OUT + o] = column[i];
    }
  }
}
