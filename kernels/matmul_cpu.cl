// Version 3 of matmul.cl, for CPU devices: a work-item computes a tile of mc x nc elements of C, after Goto and van de
// Geijn, "Anatomy of High-Performance Matrix Multiplication" (2008). Blocks of B and panels of A are packed into local
// memory (scratch of one core), tails padded with zeros, so the inner loop knows neither tails nor strides; its MR x NV
// vectors of 16 stay in registers. A_BY_COLUMN: the rows of A lie side by side (A is a transposed view). B_BY_COLUMN:
// the same of B.
#define NR (NV * 16)
// A^T B with a long depth streams both operands: what is packed next comes into the cache while this block is computed.
#if defined(__x86_64__) || defined(__aarch64__)  // compiled for the core itself: SPIR-V has no word for a prefetch
#define STREAM (A_BY_COLUMN && !B_BY_COLUMN)
#endif
// Packed A: AB rows at a time. + 16: rows a power of two apart would fall into one cache set.
#if A_BY_COLUMN
#define AB 64
#define A_AT(i, k) ((k) * (AB + 16) + (i))
#define A_SIZE (KC * (AB + 16))
#else
#define AB MR
#define A_AT(i, k) ((i) * (KC + 16) + (k))
#define A_SIZE (MR * (KC + 16))
#endif

inline void transpose16(float16 r[16]) {
  float16 t[16];
  UNROLL for (int stage = 0; stage < 4; stage++) {  // four perfect shuffles of rows make a transpose
    UNROLL for (int i = 0; i < 8; i++) {
      const float16 p = r[i], q = r[i + 8];
      t[2 * i] =
          (float16)(p.s0, q.s0, p.s1, q.s1, p.s2, q.s2, p.s3, q.s3, p.s4, q.s4, p.s5, q.s5, p.s6, q.s6, p.s7, q.s7);
      t[2 * i + 1] =
          (float16)(p.s8, q.s8, p.s9, q.s9, p.sa, q.sa, p.sb, q.sb, p.sc, q.sc, p.sd, q.sd, p.se, q.se, p.sf, q.sf);
    }
    UNROLL for (int i = 0; i < 16; i++) r[i] = t[i];
  }
}

// B block [depth, columns] -> panels [columns / NR][KC][NR].
#if B_BY_COLUMN
inline void pack_b(__local float* restrict to, __global const float* restrict b, int pitch, int depth, int columns) {
  for (int j = 0; j < columns; j += 16) {
    __local float* panel = to + (j / NR) * (KC * NR) + j % NR;
    __global const float* from = b + (size_t)j * pitch;
    for (int k = 0; k < depth; k += 16) {
      if (j + 16 <= columns && k + 16 <= depth) {
        float16 r[16];
        UNROLL for (int q = 0; q < 16; q++) r[q] = vload16(0, from + (size_t)q * pitch + k);
        transpose16(r);
        UNROLL for (int q = 0; q < 16; q++) vstore16(r[q], 0, panel + (k + q) * NR);
      } else {
        for (int v = 0; v < 16; v++)
          for (int q = k; q < min(k + 16, depth); q++)
            panel[q * NR + v] = j + v < columns ? from[(size_t)v * pitch + q] : 0.0f;
      }
    }
  }
}
#else
inline void pack_b(__local float* restrict to, __global const float* restrict b, int pitch, int depth, int columns) {
  for (int k = 0; k < depth; k++) {
    __global const float* from = b + (size_t)k * pitch;
    int j = 0;
    for (; j + 16 <= columns; j += 16) vstore16(vload16(0, from + j), 0, to + (j / NR) * (KC * NR) + k * NR + j % NR);
    for (; j % 16 != 0 || j < columns; j++) to[(j / NR) * (KC * NR) + k * NR + j % NR] = j < columns ? from[j] : 0.0f;
  }
}
#endif

// Up to AB rows of A. The panel of a tail repeats what is there: those sums are not stored.
#if A_BY_COLUMN
inline void pack_a(__local float* restrict to, __global const float* restrict a, int pitch, int depth, int rows) {
  for (int k = 0; k < depth; k++) {
    __global const float* from = a + (size_t)k * pitch;
    int i = 0;
    for (; i + 16 <= rows; i += 16) vstore16(vload16(0, from + i), 0, to + A_AT(i, k));
    for (; i < rows; i++) to[A_AT(i, k)] = from[i];
    for (; i % MR != 0; i++) to[A_AT(i, k)] = 0.0f;
  }
}
#else
inline void pack_a(__local float* restrict to, __global const float* restrict a, int pitch, int depth, int rows) {
  for (int i = 0; i < MR; i++) {
    __global const float* from = a + (size_t)min(i, rows - 1) * pitch;
    int k = 0;
    for (; k + 16 <= depth; k += 16) vstore16(vload16(0, from + k), 0, to + A_AT(i, k));
    for (; k < depth; k++) to[A_AT(i, k)] = from[k];
  }
}
#endif

// C tile (+)= packed A * packed B. `rows` and `columns` are what is left of C: beyond them nothing is stored. One line
// of the rows at `fetch` is prefetched a step.
inline void micro_tile(__local const float* restrict a, __local const float* restrict b, __global float* restrict c,
                       int pitch, int depth, int add, int rows, int columns, __local float* restrict edge,
                       __global const float* fetch, int fetch_pitch) {
  float16 acc[MR][NV];
  UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = (float16)(0.0f);
#pragma unroll 4
  for (int k = 0; k < depth; k++) {
    float16 row[NV];
    UNROLL for (int v = 0; v < NV; v++) row[v] = vload16(v, b + k * NR);
#if STREAM
    __builtin_prefetch((__global const void*)(fetch + (size_t)k * fetch_pitch), 0, 2);
#endif
    UNROLL for (int i = 0; i < MR; i++) {
      const float16 x = (float16)(a[A_AT(i, k)]);
      UNROLL for (int v = 0; v < NV; v++) acc[i][v] += x * row[v];
    }
  }
  if (rows >= MR && columns >= NR) {
    if (add) {
      UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++)
          acc[i][v] += vload16(v, c + (size_t)i * pitch);
    }
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++)
        vstore16(acc[i][v], v, c + (size_t)i * pitch);
  } else {
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) vstore16(acc[i][v], v, edge + i * NR);
    for (int i = 0; i < min(rows, MR); i++)
      for (int j = 0; j < min(columns, NR); j++)
        c[(size_t)i * pitch + j] = edge[i * NR + j] + (add ? c[(size_t)i * pitch + j] : 0.0f);
  }
}

// Group (x, y, z): columns from x * nc, rows from y * mc, z = batch * splits + split. A split sums k_each of the depth
// into its own c[z]; add_splits joins them. nc <= NC.
FAT __kernel void matmul_blocked(__global const float* restrict a, int a_offset, __global const float* restrict b,
                                 int b_offset, __global float* restrict c, int m, int n, int depth, int a_batch,
                                 int a_pitch, int b_batch, int b_pitch, int mc, int nc, int splits, int k_each) {
  __local float b_block[KC * NC] __attribute__((aligned(64)));
  __local float a_block[A_SIZE] __attribute__((aligned(64)));
  __local float edge[MR * NR] __attribute__((aligned(64)));
  const int z = get_group_id(2), batch = z / splits;
  const int j0 = get_group_id(0) * nc, columns = min(nc, n - j0);
  const int i0 = get_group_id(1) * mc, i_end = min(m, i0 + mc);
  const int k_begin = (z - batch * splits) * k_each, k_end = min(depth, k_begin + k_each);
  a += a_offset + (size_t)batch * a_batch;
  b += b_offset + (size_t)batch * b_batch;
  c += (size_t)z * m * n;
  for (int k0 = k_begin; k0 < k_end; k0 += KC) {
    const int kc = min(KC, k_end - k0);
    pack_b(b_block, B_BY_COLUMN ? b + (size_t)j0 * b_pitch + k0 : b + (size_t)k0 * b_pitch + j0, b_pitch, kc, columns);
    for (int ib = i0; ib < i_end; ib += AB) {
      const int block_end = min(i_end, ib + AB);
      pack_a(a_block, A_BY_COLUMN ? a + (size_t)k0 * a_pitch + ib : a + (size_t)ib * a_pitch + k0, a_pitch, kc,
             block_end - ib);
#if STREAM
      // The next block, line by line of its rows: of B and A at the next depth, or of the next rows of A.
      const int last = block_end == i_end, next = !last || k0 + KC < k_end;
      const int b_lines = last ? columns / 16 : 0, lines = b_lines + min(AB, last ? i_end - i0 : i_end - ib - AB) / 16;
      const int tiles = ((block_end - ib + MR - 1) / MR) * ((columns + NR - 1) / NR);
      __global const float* next_b = b + (size_t)(k0 + KC) * b_pitch + j0;
      __global const float* next_a = last ? a + (size_t)(k0 + KC) * a_pitch + i0 : a + (size_t)k0 * a_pitch + ib + AB;
      int t = 0;
#endif
      for (int i = ib; i < block_end; i += MR)
        for (int j = 0; j < columns; j += NR) {
          __global const float* fetch = c;
          int fetch_pitch = 0;
#if STREAM
          const int line = t++ * lines / tiles;
          if (next) {
            fetch = line < b_lines ? next_b + line * 16 : next_a + (line - b_lines) * 16;
            fetch_pitch = line < b_lines ? b_pitch : a_pitch;
          }
#endif
          micro_tile(a_block + A_AT(i - ib, 0), b_block + (j / NR) * (KC * NR), c + (size_t)i * n + j0 + j, n, kc,
                     k0 > k_begin, block_end - i, columns - j, edge, fetch, fetch_pitch);
        }
    }
  }
}

// c[b][e] = sum over s of parts[b][s][e], in the order of s.
FAT __kernel void add_splits(__global const float* restrict parts, __global float* restrict c, int count, int splits,
                             int chunk) {
  const size_t batch = get_group_id(1);
  parts += batch * splits * count;
  c += batch * count;
  const int end = min(count, ((int)get_group_id(0) + 1) * chunk);
  for (int e = get_group_id(0) * chunk; e < end; e++) {
    float sum = parts[e];
    for (int s = 1; s < splits; s++) sum += parts[(size_t)s * count + e];
    c[e] = sum;
  }
}
