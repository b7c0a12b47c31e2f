// Pictures compared on CPU devices, 16 columns a vector, for widths from 16 on; kernels/ssim.cl has the formulas. A piece is
// ROWS rows of a tile of up to TILE vectors: the window's means down the columns, of which a row read counts in up to ROWS,
// go to local memory, and the means along rows are taken from there. The last vector of a row that is no whole number of
// them begins earlier instead, over columns that the one before has done, so nothing is cut off. maps [rows][3][W].
//: variant ssim_rows cpu wide ROWS=4 TILE=40
#define REACH 5
#define TAPS (2 * REACH + 1)
#define PITCH (16 * (TILE + 3))  // a vector beside the tile at both sides, one of zeros behind a last one that is cut
#define C1 0.0001f               // (0.01 L)^2 and (0.03 L)^2 where values go up to L = 1
#define C2 0.0009f
__constant float WINDOW[TAPS] = {0.00102838008f, 0.00759875814f, 0.0360007721f, 0.10936069f,
                                 0.213005538f,   0.266011725f,   0.213005538f,  0.10936069f,
                                 0.0360007721f,  0.00759875814f, 0.00102838008f};

// Rows [row, row + rows) of a plane, vectors [first, last) of those in a row.
typedef struct {
  int plane, row, rows, first, last;
} Piece;

INLINE Piece piece_at(int number, int H, int W, int tile) {
  const int blocks = (H + ROWS - 1) / ROWS, vectors = (W + 15) / 16, tiles = (vectors + tile - 1) / tile;
  Piece piece;
  piece.row = number % blocks * ROWS;
  piece.rows = min(ROWS, H - piece.row);
  piece.first = number / blocks % tiles * tile;
  piece.last = min(piece.first + tile, vectors);
  piece.plane = number / blocks / tiles;
  return piece;
}

INLINE int column_of(int vector, int W) { return min(16 * vector, W - 16); }

// Row i of the ROWS + TAPS - 1 that `means` see.
INLINE void add_row(float16 means[ROWS], int i, float16 value) {
  UNROLL for (int k = 0; k < ROWS; k++) {
    if (i >= k && i < k + TAPS) means[k] += WINDOW[i - k] * value;
  }
}

// Zeros where lines of a tile stick out of the picture. Column 0 of the tile lies at 16.
INLINE void clear_outside(__local float* lines, int count, Piece piece, int W) {
  const int end = W - 16 * piece.first + 16;
  for (int line = 0; line < count; line++) {
    if (piece.first == 0) store16((float16)(0.0f), lines + line * PITCH);
    if (end + 16 <= PITCH) store16((float16)(0.0f), lines + line * PITCH + end);
  }
}

// As vload16(0, from), of which PoCL may make eight loads.
INLINE float16 load16(__global const float* from) { return *(__global const float16_anywhere*)from; }

// The window's mean along a line.
INLINE float16 across(__local const float* at) {
  float16 sum = WINDOW[0] * vload16(0, at - REACH);
  UNROLL for (int i = 1; i < TAPS; i++) sum += WINDOW[i] * vload16(0, at - REACH + i);
  return sum;
}

// Means of u, v, u^2 and v^2 down 16 columns: lines [ROWS][4].
INLINE void compare_down(__global const float* x, __global const float* y, int row, int H, int W, __local float* lines) {
  float16 mean_u[ROWS], mean_v[ROWS], square_u[ROWS], square_v[ROWS];
  UNROLL for (int k = 0; k < ROWS; k++) mean_u[k] = mean_v[k] = square_u[k] = square_v[k] = (float16)(0.0f);
  UNROLL for (int i = 0; i < ROWS + TAPS - 1; i++) {
    const int from = row - REACH + i;
    if (from >= 0 && from < H) {
      const float16 a = load16(x + from * W), b = load16(y + from * W), u = a + b, v = a - b;
      add_row(mean_u, i, u);
      add_row(mean_v, i, v);
      add_row(square_u, i, u * u);
      add_row(square_v, i, v * v);
    }
  }
  UNROLL for (int k = 0; k < ROWS; k++) {
    store16(mean_u[k], lines + (4 * k) * PITCH);
    store16(mean_v[k], lines + (4 * k + 1) * PITCH);
    store16(square_u[k], lines + (4 * k + 2) * PITCH);
    store16(square_v[k], lines + (4 * k + 3) * PITCH);
  }
}

// 1 - SSIM of 16 columns from their lines of means; the three slopes at maps, W apart, if `keep`.
INLINE float16 compare_across(__local const float* lines, __global float* maps, int W, int keep) {
  const float16 mean_u = across(lines), mean_v = across(lines + PITCH);
  const float16 uu = mean_u * mean_u, vv = mean_v * mean_v;
  const float16 variance_u = across(lines + 2 * PITCH) - uu, variance_v = across(lines + 3 * PITCH) - vv;
  const float16 over_d1 = 2.0f / (uu + vv + 2.0f * C1), over_d2 = 2.0f / (variance_u + variance_v + 2.0f * C2);
  const float16 p = vv * over_d1, q = variance_v * over_d2;
  if (keep) {
    const float16 of_p = (1.0f - q) * over_d1, of_q = (1.0f - p) * over_d2;
    const float16 slope_u = -of_q * q, slope_v = of_q * (2.0f - q);
    store16(mean_u * (-of_p * p - slope_u) + mean_v * (of_p * (2.0f - p) - slope_v), maps);
    store16(slope_u, maps + W);
    store16(slope_v, maps + 2 * W);
  }
  return p + q - p * q;
}

// sums [2][work-items]: of |x - y| and of 1 - SSIM.
__kernel FAT void ssim_rows(__global const float* restrict x, __global const float* restrict y, __global float* restrict sums,
                            __global float* restrict maps, int pieces, int H, int W, int tile, int keep, int chunk) {
  __local float lines[4 * ROWS * PITCH] __attribute__((aligned(64)));
  float16 apart = (float16)(0.0f), unlike = (float16)(0.0f);
  for (int number = LOOP_LO(chunk); number < LOOP_HI(pieces, chunk); number++) {
    const Piece piece = piece_at(number, H, W, tile);
    const size_t plane = (size_t)piece.plane * H;
    const int shift = 16 - 16 * piece.first;  // from a column to its place in a line
    for (int vector = max(piece.first - 1, 0); vector < min(piece.last + 1, (W + 15) / 16); vector++) {
      const int column = column_of(vector, W);
      compare_down(x + plane * W + column, y + plane * W + column, piece.row, H, W, lines + column + shift);
    }
    clear_outside(lines, 4 * ROWS, piece, W);
    for (int k = 0; k < piece.rows; k++)
      for (int vector = piece.first; vector < piece.last; vector++) {
        const int column = column_of(vector, W);
        const size_t row = plane + piece.row + k, at = row * W + column;
        const int16 counts = LANE_NUMBERS >= 16 * vector - column;
        const float16 value = compare_across(lines + 4 * k * PITCH + column + shift, maps + 3 * row * W + column, W, keep);
        apart += select((float16)(0.0f), fabs(load16(x + at) - load16(y + at)), counts);
        unlike += select((float16)(0.0f), value, counts);
      }
  }
  sums[get_global_id(0)] = sum16(apart);
  sums[get_global_size(0) + get_global_id(0)] = sum16(unlike);
}

// Means of the three maps down 16 columns: lines [ROWS][3].
INLINE void slopes_down(__global const float* maps, int row, int H, int W, __local float* lines) {
  float16 slope[ROWS], slope_u[ROWS], slope_v[ROWS];
  UNROLL for (int k = 0; k < ROWS; k++) slope[k] = slope_u[k] = slope_v[k] = (float16)(0.0f);
  UNROLL for (int i = 0; i < ROWS + TAPS - 1; i++) {
    const int from = row - REACH + i;
    if (from >= 0 && from < H) {
      add_row(slope, i, load16(maps + 3 * from * W));
      add_row(slope_u, i, load16(maps + (3 * from + 1) * W));
      add_row(slope_v, i, load16(maps + (3 * from + 2) * W));
    }
  }
  UNROLL for (int k = 0; k < ROWS; k++) {
    store16(slope[k], lines + (3 * k) * PITCH);
    store16(slope_u[k], lines + (3 * k + 1) * PITCH);
    store16(slope_v[k], lines + (3 * k + 2) * PITCH);
  }
}

// weights [2]: of |x - y| and of 1 - SSIM.
__kernel FAT void ssim_rows_grad(__global const float* restrict x, __global const float* restrict y,
                                 __global const float* restrict maps, __global const float* restrict weights,
                                 __global float* restrict dx, int pieces, int H, int W, int tile, int chunk) {
  __local float lines[3 * ROWS * PITCH] __attribute__((aligned(64)));
  const float16 apart = (float16)(weights[0]), unlike = (float16)(weights[1]);
  for (int number = LOOP_LO(chunk); number < LOOP_HI(pieces, chunk); number++) {
    const Piece piece = piece_at(number, H, W, tile);
    const size_t plane = (size_t)piece.plane * H;
    const int shift = 16 - 16 * piece.first;  // from a column to its place in a line
    for (int vector = max(piece.first - 1, 0); vector < min(piece.last + 1, (W + 15) / 16); vector++) {
      const int column = column_of(vector, W);
      slopes_down(maps + 3 * plane * W + column, piece.row, H, W, lines + column + shift);
    }
    clear_outside(lines, 3 * ROWS, piece, W);
    for (int k = 0; k < piece.rows; k++)
      for (int vector = piece.first; vector < piece.last; vector++) {
        const int column = column_of(vector, W);
        const size_t at = (plane + piece.row + k) * W + column;
        __local const float* from = lines + 3 * k * PITCH + column + shift;
        const float16 a = load16(x + at), b = load16(y + at), v = a - b;
        const float16 sign_of_v = select(select((float16)(0.0f), (float16)(-1.0f), v < 0.0f), (float16)(1.0f), v > 0.0f);
        const float16 slope = across(from) + (a + b) * across(from + PITCH) + v * across(from + 2 * PITCH);
        store16(apart * sign_of_v + unlike * slope, dx + at);
      }
  }
}
