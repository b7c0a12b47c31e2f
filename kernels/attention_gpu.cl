// Attention where a work-item is a lane, in the shape of Dao et al., "FlashAttention" (2022): a group of 8 x 8 lanes
// takes TILE queries (or keys) and walks the others, TILE at a time; a lane holds 4 x 4 scores and 4 x 8 sums. Wide
// heads take a group for each CHUNK columns of the result, which computes the scores again. 20 KiB of local memory.
// STEP columns of queries and keys lie in local memory at a time.
//: variant attention gpu any LANES=64 TILE=32 CHUNK=64 STEP=16
//: variant attention_grad_queries gpu queries_grad LANES=64 TILE=32 CHUNK=64 STEP=16
//: variant attention_grad_keys gpu keys_grad LANES=64 TILE=32 CHUNK=64 STEP=16
#define PITCH (TILE + 1)  // no two lanes of a row in one bank
#define FLASH __attribute__((reqd_work_group_size(LANES, 1, 1)))

// a[c][i] = x[i][first + c], zeros beyond the rows and the width.
static inline void stage_columns(__global const float* restrict x, int rows, int width, int first, __local float* restrict a) {
  for (int e = get_local_id(0); e < TILE * STEP; e += LANES) {
    const int i = e / STEP, c = e % STEP;
    a[c * PITCH + i] = i < rows && first + c < width ? x[(size_t)i * width + first + c] : 0.0f;
  }
}
// to[i][c] = x[i][first + c].
static inline void stage_rows(__global const float* restrict x, int rows, int width, int first, __local float* restrict to) {
  for (int e = get_local_id(0); e < TILE * CHUNK; e += LANES) {
    const int i = e / CHUNK, c = e % CHUNK;
    to[i * CHUNK + c] = i < rows && first + c < width ? x[(size_t)i * width + first + c] : 0.0f;
  }
}

// dots[y][x]: row 4 ly + y of a times row lx + 8 x of b, over all columns.
static inline void dot_tile(__global const float* restrict a, int a_rows, __global const float* restrict b, int b_rows, int width,
                            __local float* restrict a_part, __local float* restrict b_part, float dots[4][4]) {
  const int ly = get_local_id(0) / 8, lx = get_local_id(0) % 8;
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 4; x++) dots[y][x] = 0.0f;
  for (int first = 0; first < width; first += STEP) {
    barrier(CLK_LOCAL_MEM_FENCE);
    stage_columns(a, a_rows, width, first, a_part);
    stage_columns(b, b_rows, width, first, b_part);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int c = 0; c < STEP; c++) {
      float right[4];
      UNROLL for (int x = 0; x < 4; x++) right[x] = b_part[c * PITCH + lx + 8 * x];
      UNROLL for (int y = 0; y < 4; y++) {
        const float left = a_part[c * PITCH + 4 * ly + y];
        UNROLL for (int x = 0; x < 4; x++) dots[y][x] += left * right[x];
      }
    }
  }
}

// sums[y][x] += the product of row 4 ly + y of `tile` (of its column, where it lies transposed) and column lx + 8 x of
// `rows`. row_step and step lead to the next row and column of tile.
static inline void add_product(__local const float* restrict tile, int row_step, int step, __local const float* restrict rows,
                               float sums[4][8]) {
  const int ly = get_local_id(0) / 8, lx = get_local_id(0) % 8;
  for (int k = 0; k < TILE; k++) {
    float right[8];
    UNROLL for (int x = 0; x < 8; x++) right[x] = rows[k * CHUNK + lx + 8 * x];
    UNROLL for (int y = 0; y < 4; y++) {
      const float left = tile[(4 * ly + y) * row_step + k * step];
      UNROLL for (int x = 0; x < 8; x++) sums[y][x] += left * right[x];
    }
  }
}

static inline void store_sums(float sums[4][8], int rows, int width, int first, float by, __global float* restrict to) {
  const int ly = get_local_id(0) / 8, lx = get_local_id(0) % 8;
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) {
    const int i = 4 * ly + y, c = first + lx + 8 * x;
    if (i < rows && c < width) to[(size_t)i * width + c] = sums[y][x] * by;
  }
}

static inline void store_tile(float dots[4][4], __local float* restrict tile) {
  const int ly = get_local_id(0) / 8, lx = get_local_id(0) % 8;
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 4; x++) tile[(4 * ly + y) * PITCH + lx + 8 * x] = dots[y][x];
}

// Arguments as in attention_cpu.cl. Group (block of queries, batch, chunk of columns of the result).
FLASH __kernel void attention(__global const float* restrict q, __global const float* restrict k,
                              __global const float* restrict v, __global float* restrict out,
                              __global float* restrict logs, int T, int U, float scale) {
  __local float query_part[STEP * PITCH], key_part[STEP * PITCH], shares[TILE * PITCH], values[TILE * CHUNK];
  __local float top[TILE], total[TILE], shrink[TILE];
  const int lane = get_local_id(0), ly = lane / 8, first_column = get_group_id(2) * CHUNK;
  const size_t batch = get_group_id(1);
  const int first = get_group_id(0) * TILE, rows = min(TILE, T - first);
  q += (batch * T + first) * D;
  float sums[4][8];
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) sums[y][x] = 0.0f;
  if (lane < TILE) top[lane] = -INFINITY, total[lane] = 0.0f;
  for (int u = 0; u < U; u += TILE) {
    const int n = min(TILE, U - u);
    float dots[4][4];
    dot_tile(q, rows, k + (batch * U + u) * D, n, D, query_part, key_part, dots);
    store_tile(dots, shares);
    stage_rows(v + (batch * U + u) * E, n, E, first_column, values);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane < TILE) {  // the softmax of row `lane`, corrected for what came before
      float largest = top[lane], sum = 0.0f;
      for (int j = 0; j < n; j++) largest = fmax(largest, shares[lane * PITCH + j] * scale);
      for (int j = 0; j < TILE; j++) {
        const float share = j < n ? m_exp(shares[lane * PITCH + j] * scale - largest) : 0.0f;
        shares[lane * PITCH + j] = share;
        sum += share;
      }
      shrink[lane] = m_exp(top[lane] - largest);
      total[lane] = total[lane] * shrink[lane] + sum;
      top[lane] = largest;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) sums[y][x] *= shrink[4 * ly + y];
    add_product(shares, PITCH, 1, values, sums);
  }
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) sums[y][x] /= total[4 * ly + y];
  store_sums(sums, rows, E, first_column, 1.0f, out + (batch * T + first) * E);
  if (get_group_id(2) == 0 && lane < rows) logs[batch * T + first + lane] = top[lane] + m_log(total[lane]);
}

// shares = P and slopes = P (dP - delta) of queries from t and keys from u, in local tiles of [query][key], 0 beyond
// both; either tile may be null.
static inline void share_tiles(__global const float* restrict q, __global const float* restrict k,
                               __global const float* restrict v, __global const float* restrict dout,
                               __global const float* restrict logs, __global const float* restrict delta, int rows, int n,
                               float scale, __local float* a_part, __local float* b_part, __local float* shares,
                               __local float* slopes) {
  const int ly = get_local_id(0) / 8, lx = get_local_id(0) % 8;
  float scores[4][4], given[4][4];
  dot_tile(q, rows, k, n, D, a_part, b_part, scores);
  dot_tile(dout, rows, v, n, E, a_part, b_part, given);
  UNROLL for (int y = 0; y < 4; y++) {
    const int i = 4 * ly + y;
    const float log_sum = i < rows ? logs[i] : 0.0f, mean_slope = i < rows ? delta[i] : 0.0f;
    UNROLL for (int x = 0; x < 4; x++) {
      const int inside = i < rows && lx + 8 * x < n;
      scores[y][x] = inside ? m_exp(scores[y][x] * scale - log_sum) : 0.0f;
      given[y][x] = scores[y][x] * (given[y][x] - mean_slope);
    }
  }
  store_tile(scores, shares);
  store_tile(given, slopes);
}

// dq = dS k: group (block of queries, batch, chunk of columns).
FLASH __kernel void attention_grad_queries(__global const float* restrict q, __global const float* restrict k,
                                           __global const float* restrict v, __global const float* restrict dout,
                                           __global const float* restrict logs, __global const float* restrict delta,
                                           __global float* restrict out, int T, int U, float scale) {
  __local float a_part[STEP * PITCH], b_part[STEP * PITCH], shares[TILE * PITCH], slopes[TILE * PITCH];
  __local float keys[TILE * CHUNK];
  const int first_column = get_group_id(2) * CHUNK, first = get_group_id(0) * TILE, rows = min(TILE, T - first);
  const size_t batch = get_group_id(1), row = batch * T + first;
  float sums[4][8];
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) sums[y][x] = 0.0f;
  for (int u = 0; u < U; u += TILE) {
    const int n = min(TILE, U - u);
    const size_t key = batch * U + u;
    share_tiles(q + row * D, k + key * D, v + key * E, dout + row * E, logs + row, delta + row, rows, n, scale, a_part,
                b_part, shares, slopes);
    stage_rows(k + key * D, n, D, first_column, keys);
    barrier(CLK_LOCAL_MEM_FENCE);
    add_product(slopes, PITCH, 1, keys, sums);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  store_sums(sums, rows, D, first_column, scale, out + row * D);
}

// dk = dS^T q and dv = P^T dout: group (block of keys, batch, chunk of columns of either).
FLASH __kernel void attention_grad_keys(__global const float* restrict q, __global const float* restrict k,
                                        __global const float* restrict v, __global const float* restrict dout,
                                        __global const float* restrict logs, __global const float* restrict delta,
                                        __global float* restrict out, int T, int U, float scale) {
  __local float a_part[STEP * PITCH], b_part[STEP * PITCH], shares[TILE * PITCH], slopes[TILE * PITCH];
  __local float rows_part[TILE * CHUNK];
  const int first_column = get_group_id(2) * CHUNK, first = get_group_id(0) * TILE, n = min(TILE, U - first);
  const size_t batch = get_group_id(1), batches = get_num_groups(1), key = batch * U + first;
  float key_sums[4][8], value_sums[4][8];
  UNROLL for (int y = 0; y < 4; y++) UNROLL for (int x = 0; x < 8; x++) key_sums[y][x] = 0.0f, value_sums[y][x] = 0.0f;
  for (int t = 0; t < T; t += TILE) {
    const int rows = min(TILE, T - t);
    const size_t row = batch * T + t;
    share_tiles(q + row * D, k + key * D, v + key * E, dout + row * E, logs + row, delta + row, rows, n, scale, a_part,
                b_part, shares, slopes);
    stage_rows(q + row * D, rows, D, first_column, rows_part);
    barrier(CLK_LOCAL_MEM_FENCE);
    add_product(slopes, 1, PITCH, rows_part, key_sums);
    barrier(CLK_LOCAL_MEM_FENCE);
    stage_rows(dout + row * E, rows, E, first_column, rows_part);
    barrier(CLK_LOCAL_MEM_FENCE);
    add_product(shares, 1, PITCH, rows_part, value_sums);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  store_sums(key_sums, n, D, first_column, scale, out + batches * T * D + key * D);
  store_sums(value_sums, n, E, first_column, 1.0f, out + batches * (T + U) * D + key * E);
}
