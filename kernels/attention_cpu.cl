// Attention for CPU devices without the matrix of scores, after Milakov and Gimelshein, "Online normalizer calculation
// for softmax" (2018) and Dao et al., "FlashAttention" (2022): blocks of scores live in scratch, the softmax is
// corrected as larger scores come. Blocks of rows are copied to local memory (scratch of one core), padded there, so
// that products know no tails; all of them are one register tile of 8 x 32. The composition in
// runtime/ops/attention.cpp is version 1. Constants: D and E, the widths of keys and values; BQ queries x BK keys.
// Sizes: narrow, medium and wide for widths up to 64, 128 and 512.
//: variant attention cpu narrow BQ=128 BK=128
//: variant attention cpu medium BQ=64 BK=64
//: variant attention cpu wide BQ=32 BK=32
//: variant attention_grad cpu narrow_grad BQ=64 BK=64
//: variant attention_grad cpu medium_grad BQ=64 BK=64
//: variant attention_grad cpu wide_grad BQ=32 BK=32
#define PAD32(n) (((n) + 31) / 32 * 32)
// Pitches of rows: + 16, as rows a power of two apart would fall into one cache set.
#define DL (PAD32(D) + 16)
#define EL (PAD32(E) + 16)
#define KL (BK + 16)
#define LOG2E 1.44269504f

// Rows of x [rows, width] to local memory; columns up to a multiple of 32 and rows up to one of 8 are zeros.
inline void copy_rows(__global const float* restrict x, int rows, int width, __local float* restrict to, int pitch) {
  for (int i = 0; i < (rows + 7) / 8 * 8; i++) {
    int j = 0;
    if (i < rows) {
      for (; j + 16 <= width; j += 16) vstore16(vload16(0, x + (size_t)i * width + j), 0, to + i * pitch + j);
      for (; j < width; j++) to[i * pitch + j] = x[(size_t)i * width + j];
    }
    for (; j < PAD32(width); j++) to[i * pitch + j] = 0.0f;
  }
}

// The same transposed: to [width][KL], rows (now columns) up to a multiple of 32 are zeros.
inline void copy_transposed(__global const float* restrict x, int rows, int width, __local float* restrict to) {
  for (int i = 0; i < PAD32(rows); i += 16)
    for (int j = 0; j < width; j += 16) {
      if (i + 16 <= rows && j + 16 <= width) {
        float16 r[16];
        UNROLL for (int q = 0; q < 16; q++) r[q] = vload16(0, x + (size_t)(i + q) * width + j);
        transpose16(r);
        UNROLL for (int q = 0; q < 16; q++) vstore16(r[q], 0, to + (j + q) * KL + i);
      } else {
        for (int q = j; q < min(j + 16, width); q++)
          for (int p = i; p < i + 16; p++) to[q * KL + p] = p < rows ? x[(size_t)p * width + q] : 0.0f;
      }
    }
}

inline void fill_rows(__local float* restrict to, int count) {
  for (int i = 0; i < count; i += 16) vstore16((float16)(0.0f), 0, to + i);
}

// Rows (a multiple of 8) and columns (one of 32) of c = a b, or c += a b. a_row and a_step lead to the next row and
// column of a: a transposed a costs nothing.
inline void multiply(__local const float* restrict a, int a_row, int a_step, __local const float* restrict b, int b_pitch,
                     __local float* restrict c, int c_pitch, int rows, int columns, int depth, int add) {
  for (int j = 0; j < columns; j += 32)
    for (int i = 0; i < rows; i += 8) {
      float16 sum[8][2];
      UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
          sum[r][v] = add ? vload16(v, c + (i + r) * c_pitch + j) : (float16)(0.0f);
#pragma unroll 4
      for (int k = 0; k < depth; k++) {
        const float16 b0 = vload16(0, b + k * b_pitch + j), b1 = vload16(1, b + k * b_pitch + j);
        UNROLL for (int r = 0; r < 8; r++) {
          const float16 x = (float16)(a[(i + r) * a_row + k * a_step]);
          sum[r][0] += x * b0;
          sum[r][1] += x * b1;
        }
      }
      UNROLL for (int r = 0; r < 8; r++) UNROLL for (int v = 0; v < 2; v++)
          vstore16(sum[r][v], v, c + (i + r) * c_pitch + j);
    }
}

// Lanes from `left` on become `fill`.
inline float16 cut_off(float16 value, int left, float fill) {
  if (left >= 16) return value;
  const int16 lane = (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  return lane < left ? value : (float16)(fill);
}

// A row of n scores becomes 2^(factor * score - top), top the largest so far; returns what earlier sums shrink by.
inline float soften(__local float* restrict scores, int n, float factor, __local float* restrict top,
                    __local float* restrict total) {
  float16 largest = (float16)(-INFINITY);
  for (int j = 0; j < n; j += 16) largest = fmax(largest, cut_off(vload16(0, scores + j), n - j, -INFINITY));
  const float before = *top, now = fmax(before, max16(largest) * factor);
  float16 sum = (float16)(0.0f);
  for (int j = 0; j < n; j += 16) {
    const float16 share = m_exp2_16(vload16(0, scores + j) * factor - now);
    sum += cut_off(share, n - j, 0.0f);
    vstore16(share, 0, scores + j);
  }
  const float shrink = before == -INFINITY ? 0.0f : m_exp((before - now) / LOG2E);
  *top = now;
  *total = *total * shrink + sum16(sum);
  return shrink;
}

// q [batch, T, D], k [batch, U, D], v [batch, U, E] -> out [batch, T, E]; logs [batch, T]: logarithms of the sums of
// exp(score). Group (block of queries, batch).
FAT __kernel void attention(__global const float* restrict q, __global const float* restrict k,
                            __global const float* restrict v, __global float* restrict out, __global float* restrict logs,
                            int T, int U, float scale) {
  __local float queries[BQ * DL] __attribute__((aligned(64)));
  __local float sums[BQ * EL] __attribute__((aligned(64)));
  __local float keys[D * KL] __attribute__((aligned(64)));
  __local float values[BK * EL] __attribute__((aligned(64)));
  __local float scores[8 * KL] __attribute__((aligned(64)));
  __local float top[BQ], total[BQ];
  const size_t batch = get_group_id(1);
  const int first = get_group_id(0) * BQ, rows = min(BQ, T - first);
  q += (batch * T + first) * D;
  k += batch * U * D;
  v += batch * U * E;
  out += (batch * T + first) * E;
  logs += batch * T + first;
  copy_rows(q, rows, D, queries, DL);
  fill_rows(sums, BQ * EL);
  for (int i = 0; i < BQ; i++) top[i] = -INFINITY, total[i] = 0.0f;
  for (int u = 0; u < U; u += BK) {
    const int n = min(BK, U - u);
    copy_transposed(k + (size_t)u * D, n, D, keys);
    copy_rows(v + (size_t)u * E, n, E, values, EL);
    for (int i = 0; i < rows; i += 8) {
      multiply(queries + i * DL, DL, 1, keys, KL, scores, KL, 8, PAD32(n), D, 0);
      for (int r = 0; r < 8; r++) {
        const float shrink = soften(scores + r * KL, n, scale * LOG2E, top + i + r, total + i + r);
        __local float* sum = sums + (i + r) * EL;
        for (int j = 0; j < E; j += 16) vstore16(vload16(0, sum + j) * shrink, 0, sum + j);
      }
      multiply(scores, KL, 1, values, EL, sums + i * EL, EL, 8, PAD32(E), n, 1);
    }
  }
  for (int i = 0; i < rows; i++) {
    const float by = 1.0f / total[i];
    int j = 0;
    for (; j + 16 <= E; j += 16) vstore16(vload16(0, sums + i * EL + j) * by, 0, out + (size_t)i * E + j);
    for (; j < E; j++) out[(size_t)i * E + j] = sums[i * EL + j] * by;
    logs[i] = top[i] / LOG2E + m_log(total[i]);
  }
}

// to [rows, width] = from * by, or += where `add`.
inline void write_rows(__local const float* restrict from, int pitch, int rows, int width, float by,
                       __global float* restrict to, int add) {
  for (int i = 0; i < rows; i++) {
    __global float* row = to + (size_t)i * width;
    int j = 0;
    for (; j + 16 <= width; j += 16) {
      const float16 value = vload16(0, from + i * pitch + j) * by;
      vstore16(add ? value + vload16(0, row + j) : value, 0, row + j);
    }
    for (; j < width; j++) row[j] = from[i * pitch + j] * by + (add ? row[j] : 0.0f);
  }
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
  __local float slopes[BQ * KL] __attribute__((aligned(64)));  // dP, then dS
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
    copy_transposed(k_block, n, D, key_columns);
    copy_transposed(v + (batch * U + u) * E, n, E, value_columns);
    fill_rows(key_sums, BK * DL);
    fill_rows(value_sums, BK * EL);
    for (int t = 0; t < T; t += BQ) {
      const int rows = min(BQ, T - t), rows8 = (rows + 7) / 8 * 8, n8 = (n + 7) / 8 * 8;
      copy_rows(q + (size_t)t * D, rows, D, queries, DL);
      copy_rows(dout + (size_t)t * E, rows, E, given, EL);
      multiply(queries, DL, 1, key_columns, KL, shares, KL, rows8, PAD32(n), D, 0);
      multiply(given, EL, 1, value_columns, KL, slopes, KL, rows8, PAD32(n), E, 0);
      for (int i = 0; i < rows; i++) {
        const float log_sum = logs[batch * T + t + i] * LOG2E, mean_slope = delta[batch * T + t + i];
        for (int j = 0; j < n; j += 16) {
          const int at = i * KL + j;
          const float16 share = m_exp2_16(vload16(0, shares + at) * (scale * LOG2E) - log_sum);
          vstore16(share, 0, shares + at);
          vstore16(share * (vload16(0, slopes + at) - mean_slope), 0, slopes + at);
        }
      }
      multiply(shares, 1, KL, given, EL, value_sums, EL, n8, PAD32(E), rows, 1);
      multiply(slopes, 1, KL, queries, DL, key_sums, DL, n8, PAD32(D), rows, 1);
      multiply(slopes, KL, 1, keys, DL, query_sums, DL, rows8, PAD32(D), n, 0);
      write_rows(query_sums, DL, rows, D, scale, dq + (size_t)t * D, u > u_begin);
    }
    write_rows(key_sums, DL, n, D, scale, dk + (size_t)u * D, 0);
    write_rows(value_sums, EL, n, E, 1.0f, dv + (size_t)u * E, 0);
  }
}
