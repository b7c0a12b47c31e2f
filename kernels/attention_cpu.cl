// Attention for CPU devices without the matrix of scores, after Milakov and Gimelshein, "Online normalizer calculation
// for softmax" (2018) and Dao et al., "FlashAttention" (2022): blocks of scores live in scratch, the softmax is
// corrected as much larger scores come. Blocks of rows are copied to local memory (scratch of one core), padded there,
// so that products know no tails; all of them are one register tile of 8 x 32. The composition in
// runtime/ops/attention.cpp is version 1. Constants: D and E, the widths of keys and values; BQ queries x BK keys.
// Sizes: narrow, medium and wide for widths up to 64, 128 and 512.
//: variant attention cpu narrow BQ=128 BK=128
//: variant attention cpu medium BQ=64 BK=64
//: variant attention cpu wide BQ=32 BK=32
//: variant attention_grad cpu narrow_grad BQ=64 BK=128
//: variant attention_grad cpu medium_grad BQ=64 BK=64
//: variant attention_grad cpu wide_grad BQ=32 BK=32
#define PAD32(n) (((n) + 31) / 32 * 32)
// Pitches of rows: + 16, as rows a power of two apart would fall into one cache set.
#define DL (PAD32(D) + 16)
#define EL (PAD32(E) + 16)
#define QL (BQ + 16)
#define KL (BK + 16)
#define LOG2E 1.44269504f
// Scores are exponents of two here, less the `top` of their query; beyond this, top follows and sums shrink.
#define SLACK 16.0f

// Rows of x [rows, width] to local memory, `pitch` apart; columns up to a multiple of 32 are zeros, rows up to one of 8
// are the last row again.
static inline void copy_rows(__global const float* restrict x, int rows, int width, __local float* restrict to, int pitch) {
  for (int i = 0; i < (rows + 7) / 8 * 8; i++) {
    __global const float* row = x + (size_t)min(i, rows - 1) * width;
    int j = 0;
    for (; j + 16 <= width; j += 16) store16(vload16(0, row + j), to + i * pitch + j);
    for (; j < width; j++) to[i * pitch + j] = row[j];
    for (; j < PAD32(width); j++) to[i * pitch + j] = 0.0f;
  }
}

// x transposed: to [width][pitch], rows (now columns) up to a multiple of 32 are zeros.
static inline void copy_transposed(__global const float* restrict x, int rows, int width, __local float* restrict to,
                                   int pitch) {
  for (int i = 0; i < PAD32(rows); i += 16)
    for (int j = 0; j < width; j += 16) {
      if (i + 16 <= rows && j + 16 <= width) {
        float16 r[16];
        UNROLL for (int q = 0; q < 16; q++) r[q] = vload16(0, x + (size_t)(i + q) * width + j);
        transpose16(r);
        UNROLL for (int q = 0; q < 16; q++) store16(r[q], to + (j + q) * pitch + i);
      } else {
        for (int q = j; q < min(j + 16, width); q++)
          for (int p = i; p < i + 16; p++) to[q * pitch + p] = p < rows ? x[(size_t)p * width + q] : 0.0f;
      }
    }
}

// sum += 8 rows of column k of a by 32 columns of row k of b.
static inline void add_column(__local const float* restrict a, int a_row, __local const float* restrict b, float16 sum[8][2]) {
  const float16 b0 = vload16(0, b), b1 = vload16(1, b);
  UNROLL for (int r = 0; r < 8; r++) {
    const float16 x = (float16)(a[r * a_row]);
    sum[r][0] += x * b0;
    sum[r][1] += x * b1;
  }
}

// sum += 8 rows of a by 32 columns of b. a_row and a_step lead to the next row and column of a: a transposed a costs
// nothing. Four columns at a time by hand: where the compiler (LLVM 14) unrolls for AVX-512, the columns that are left
// over (130 = 32 * 4 + 2) come out as NaN.
static inline void add_tile(__local const float* restrict a, int a_row, int a_step, __local const float* restrict b, int b_pitch,
                            int depth, float16 sum[8][2]) {
  int k = 0;
  for (; k + 4 <= depth; k += 4)
    UNROLL for (int s = 0; s < 4; s++) add_column(a + (k + s) * a_step, a_row, b + (k + s) * b_pitch, sum);
  for (; k < depth; k++) add_column(a + k * a_step, a_row, b + k * b_pitch, sum);
}

static inline void clear_tile(float16 sum[8][2]) {
  UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++) sum[r][v] = (float16)(0.0f);
}

// Rows (a multiple of 8) and columns (one of 32) of c = a b, or c += a b.
static inline void multiply(__local const float* restrict a, int a_row, int a_step, __local const float* restrict b, int b_pitch,
                            __local float* restrict c, int c_pitch, int rows, int columns, int depth, int add) {
  for (int j = 0; j < columns; j += 32)
    for (int i = 0; i < rows; i += 8) {
      __local float* tile = c + i * c_pitch + j;
      float16 sum[8][2];
      clear_tile(sum);
      if (add)
        UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
            sum[r][v] = vload16(v, tile + r * c_pitch);
      add_tile(a + i * a_row, a_row, a_step, b + j, b_pitch, depth, sum);
      UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
          store16(sum[r][v], tile + r * c_pitch + 16 * v);
    }
}

// 2^x for x up to SLACK.
static inline float16 share16(float16 x) {
  const float16 c = x < -125.0f ? (float16)(-125.0f) : x;
  const float16 t = c + 12582912.0f;
  return m_exp2_parts16(t, c - (t - 12582912.0f));
}

// Scores of 32 queries outgrew `top`: it becomes `largest`, where that is more, and what was summed shrinks; `summed`:
// whether sums hold blocks of keys before this one.
static inline void raise_top(const float16 largest[2], __local float* restrict top, __local float* restrict total,
                             __local float* restrict shares, int keys, __local float* restrict sums, int summed) {
  float shrink[32];
  UNROLL for (int v = 0; v < 2; v++) {
    const float16 before = vload16(v, top), now = fmax(before, largest[v]), by = m_exp2_16(before - now);
    store16(now, top + 16 * v);
    store16(vload16(v, total) * by, total + 16 * v);
    for (int i = 0; i < keys; i++) store16(vload16(v, shares + 32 * i) * by, shares + 32 * i + 16 * v);
    vstore16(by, v, shrink);
  }
  for (int i = 0; i < (summed ? 32 : 0); i++)
    for (int j = 0; j < E; j += 16) store16(vload16(0, sums + i * EL + j) * shrink[i], sums + i * EL + j);
}

// Rows from `left` on are not counted.
static inline void cut_tile(int left, float16 score[8][2]) {
  UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
      score[r][v] = r < left ? score[r][v] : (float16)(-INFINITY);
}

// Products of keys [n, DL] and 32 queries, in columns of `queries`, become shares [n][32] = 2^(factor * product - top).
// A lane is a query: maxima and totals cross no lanes.
static inline void share_keys(__local const float* restrict keys, int n, __local const float* restrict queries, float factor,
                              __local float* restrict shares, __local float* restrict top, __local float* restrict total,
                              __local float* restrict sums, int summed) {
  for (int i = 0; i < n;) {
    float16 score[8][2], largest[2];
    clear_tile(score);
    add_tile(keys + i * DL, DL, 1, queries, QL, D, score);
    if (i + 8 > n) cut_tile(n - i, score);
    UNROLL for (int v = 0; v < 2; v++) {
      largest[v] = score[0][v];
      UNROLL for (int r = 1; r < 8; r++) largest[v] = largest[v] > score[r][v] ? largest[v] : score[r][v];
      largest[v] *= factor;
    }
    if (any((largest[0] - vload16(0, top) > SLACK) | (largest[1] - vload16(1, top) > SLACK))) {
      raise_top(largest, top, total, shares, i, sums, summed);
      continue;  // the tile once more: to keep its products would cost every tile
    }
    UNROLL for (int v = 0; v < 2; v++) {
      const float16 level = vload16(v, top);
      float16 sum = vload16(v, total);
      UNROLL for (int r = 0; r < 8; r++) {
        const float16 share = share16(score[r][v] * factor - level);
        store16(share, shares + 32 * (i + r) + 16 * v);
        sum += share;
      }
      store16(sum, total + 16 * v);
    }
    i += 8;
  }
}

// q [batch, T, D], k [batch, U, D], v [batch, U, E] -> out [batch, T, E]; logs [batch, T]: logarithms of the sums of
// exp(score). Group (block of queries, batch).
FAT __kernel void attention(__global const float* restrict q, __global const float* restrict k,
                            __global const float* restrict v, __global float* restrict out, __global float* restrict logs,
                            int T, int U, float scale) {
  __local float queries[D * QL] __attribute__((aligned(64)));
  __local float sums[BQ * EL] __attribute__((aligned(64)));
  __local float keys[BK * DL] __attribute__((aligned(64)));
  __local float values[BK * EL] __attribute__((aligned(64)));
  __local float shares[BK * 32] __attribute__((aligned(64)));
  __local float top[BQ] __attribute__((aligned(64)));
  __local float total[BQ] __attribute__((aligned(64)));
  const size_t batch = get_group_id(1);
  const int first = get_group_id(0) * BQ, rows = min(BQ, T - first);
  q += (batch * T + first) * D;
  k += batch * U * D;
  v += batch * U * E;
  out += (batch * T + first) * E;
  logs += batch * T + first;
  copy_transposed(q, rows, D, queries, QL);
  for (int i = 0; i < BQ; i++) top[i] = -1e30f, total[i] = 0.0f;
  for (int u = 0; u < U; u += BK) {
    const int n = min(BK, U - u);
    copy_rows(k + (size_t)u * D, n, D, keys, DL);
    copy_rows(v + (size_t)u * E, n, E, values, EL);
    for (int i = 0; i < rows; i += 32) {
      share_keys(keys, n, queries + i, scale * LOG2E, shares, top + i, total + i, sums + i * EL,
                 u > 0);
      multiply(shares, 1, 32, values, EL, sums + i * EL, EL, min(32, (rows - i + 7) / 8 * 8), PAD32(E), n, u > 0);
    }
  }
  for (int i = 0; i < rows; i++) {
    const float by = 1.0f / total[i];
    int j = 0;
    for (; j + 16 <= E; j += 16) store16(vload16(0, sums + i * EL + j) * by, out + (size_t)i * E + j);
    for (; j < E; j++) out[(size_t)i * E + j] = sums[i * EL + j] * by;
    logs[i] = top[i] / LOG2E + m_log(total[i]);
  }
}

// to [rows, width] = from * by, or += where `add`.
static inline void write_rows(__local const float* restrict from, int pitch, int rows, int width, float by,
                              __global float* restrict to, int add) {
  for (int i = 0; i < rows; i++) {
    __global float* row = to + (size_t)i * width;
    int j = 0;
    for (; j + 16 <= width; j += 16) {
      const float16 value = vload16(0, from + i * pitch + j) * by;
      store16(add ? value + vload16(0, row + j) : value, row + j);
    }
    for (; j < width; j++) row[j] = from[i * pitch + j] * by + (add ? row[j] : 0.0f);
  }
}

// Shares of 8 queries and 32 keys: P, and dS by `slopes`.
static inline void share_slopes(__local const float* restrict queries, __local const float* restrict key_columns,
                                __local const float* restrict given, __local const float* restrict value_columns,
                                __local const float* restrict levels, __local const float* restrict means, float factor,
                                __local float* restrict shares, __local float* restrict slopes) {
  float16 sum[8][2];
  clear_tile(sum);
  add_tile(queries, DL, 1, key_columns, KL, D, sum);
  UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
      store16(share16(sum[r][v] * factor - levels[r]), shares + r * KL + 16 * v);
  clear_tile(sum);
  add_tile(given, EL, 1, value_columns, KL, E, sum);
  UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
      store16(vload16(v, shares + r * KL) * (sum[r][v] - means[r]), slopes + r * KL + 16 * v);
}

// With P the softmax, dP = dout v^T and dS = P (dP - delta), delta [batch, T] the sums of dout * out over a row:
// dq = dS k, dk = dS^T q, both by `scale`, dv = P^T dout. Group (part, batch) walks blocks_each blocks of keys over all
// queries; out, one after another: sums of dq, a [batch, T, D] for each part; dk; dv.
FAT __kernel void attention_grad(__global const float* restrict q, __global const float* restrict k,
                                 __global const float* restrict v, __global const float* restrict dout,
                                 __global const float* restrict logs, __global const float* restrict delta,
                                 __global float* out, int T, int U, float scale,
                                 int blocks_each) {
  __local float queries[BQ * DL] __attribute__((aligned(64)));
  __local float given[BQ * EL] __attribute__((aligned(64)));  // rows of dout
  __local float query_sums[BQ * DL] __attribute__((aligned(64)));
  __local float keys[BK * DL] __attribute__((aligned(64)));
  __local float key_columns[D * KL] __attribute__((aligned(64)));
  __local float value_columns[E * KL] __attribute__((aligned(64)));
  __local float key_sums[BK * DL] __attribute__((aligned(64)));
  __local float value_sums[BK * EL] __attribute__((aligned(64)));
  __local float shares[BQ * KL] __attribute__((aligned(64)));  // P
  __local float slopes[BQ * KL] __attribute__((aligned(64)));  // dS
  __local float levels[BQ], means[BQ];
  const size_t batch = get_group_id(1), batches = get_num_groups(1);
  const int u_begin = get_group_id(0) * blocks_each * BK, u_end = min(U, u_begin + blocks_each * BK);
  q += batch * T * D;
  dout += batch * T * E;
  __global float* dq = out + (get_group_id(0) * batches + batch) * T * D;
  __global float* dk = out + (get_num_groups(0) * batches) * T * D + batch * U * D;
  __global float* dv = dk + (batches - batch) * U * D + batch * U * E;
  for (int u = u_begin; u < u_end; u += BK) {
    const int n = min(BK, U - u);
    __global const float* k_block = k + (batch * U + u) * D;
    copy_rows(k_block, n, D, keys, DL);
    copy_transposed(k_block, n, D, key_columns, KL);
    copy_transposed(v + (batch * U + u) * E, n, E, value_columns, KL);
    for (int t = 0; t < T; t += BQ) {
      const int rows = min(BQ, T - t), rows8 = (rows + 7) / 8 * 8, n8 = (n + 7) / 8 * 8;
      copy_rows(q + (size_t)t * D, rows, D, queries, DL);
      copy_rows(dout + (size_t)t * E, rows, E, given, EL);
      for (int i = 0; i < rows8; i++) {
        const size_t row = batch * T + t + min(i, rows - 1);
        levels[i] = logs[row] * LOG2E;
        means[i] = delta[row];
      }
      for (int j = 0; j < n; j += 32)
        for (int i = 0; i < rows8; i += 8)
          share_slopes(queries + i * DL, key_columns + j, given + i * EL, value_columns + j, levels + i, means + i,
                       scale * LOG2E, shares + i * KL + j, slopes + i * KL + j);
      multiply(shares, 1, KL, given, EL, value_sums, EL, n8, PAD32(E), rows, t > 0);
      multiply(slopes, 1, KL, queries, DL, key_sums, DL, n8, PAD32(D), rows, t > 0);
      multiply(slopes, KL, 1, keys, DL, query_sums, DL, rows8, PAD32(D), n, 0);
      write_rows(query_sums, DL, rows, D, scale, dq + (size_t)t * D, u > u_begin);
    }
    write_rows(key_sums, DL, n, D, scale, dk + (size_t)u * D, 0);
    write_rows(value_sums, EL, n, E, 1.0f, dv + (size_t)u * E, 0);
  }
}
