// Version 3 of matmul.cl, for CPU devices: a work-item computes a tile of mc x nc elements of C, after Goto and van de
// Geijn, "Anatomy of High-Performance Matrix Multiplication" (2008). MR x NV vectors of 16 elements of C stay in
// registers; each is one sum over k in ascending order, taken up from C at every block of KC, so that no choice of
// tiles changes a bit. Panels of B are packed into local memory (scratch of one core) by the very first rows that use
// them. A_BY_COLUMN: the rows of A lie side by side (A is a transposed view). B_BY_COLUMN: the same of B. A_PACKED: so
// are the columns of A, where they lie far apart.
//: variant matmul_blocked cpu wide MR=4 NV=4 KC=512 NC=256
//: variant matmul_blocked cpu wide MR=4 NV=4 KC=256 NC=256
//: variant matmul_blocked cpu wide MR=8 NV=2 KC=512 NC=256
//: variant matmul_blocked cpu flat MR=4 NV=4 KC=576 NC=128
//: variant matmul_blocked cpu flat MR=4 NV=4 KC=192 NC=256
//: variant matmul_blocked cpu narrow MR=8 NV=2 KC=256 NC=256
//: variant matmul_blocked cpu thin MR=8 NV=1 KC=256 NC=256
//: variant matmul_blocked cpu compact MR=4 NV=4 KC=32 NC=64
#define NR (NV * 16)
#if defined(__x86_64__) || defined(__aarch64__)  // compiled for the core itself: SPIR-V has no word for a prefetch
#define PREFETCH(p) __builtin_prefetch((__global const void*)(p), 0, 2)
#define PREFETCH_WRITE(p) __builtin_prefetch((__global const void*)(p), 1, 2)
#else
#define PREFETCH_WRITE(p)
#define PREFETCH(p)
#endif
// Element (i, k) of a panel of A: at[i] + k * A_STEP. A by column with rows far apart is packed, AB rows at a time: its
// columns would fall into few cache sets.
#if A_PACKED
#define AB 64
#define A_SPACE __local
#define PANEL (KC * MR + 16)  // + 16: as above
#define A_STEP(pitch) MR
#else
#define AB MR
#define A_SPACE __global
#define A_STEP(pitch) (A_BY_COLUMN ? (pitch) : 1)
#endif

// Columns j .. j + NR of a block of B -> panel [depth][NR], zeros from `columns` on.
#if B_BY_COLUMN
static inline void pack_b(__local float* restrict to, __global const float* restrict b, int pitch, int depth, int columns) {
  for (int j = 0; j < NR; j += 16) {
    __local float* panel = to + j;
    __global const float* from = b + (size_t)j * pitch;
    for (int k = 0; k < depth; k += 16) {
      if (j + 16 <= columns && k + 16 <= depth) {
        float16 r[16];
        UNROLL for (int q = 0; q < 16; q++) r[q] = vload16(0, from + (size_t)q * pitch + k);
        transpose16(r);
        UNROLL for (int q = 0; q < 16; q++) store16(r[q], panel + (k + q) * NR);
      } else {
        for (int q = k; q < min(k + 16, depth); q++)
          for (int v = 0; v < 16; v++) panel[q * NR + v] = j + v < columns ? from[(size_t)v * pitch + q] : 0.0f;
      }
    }
  }
}
#else
static inline void pack_b(__local float* restrict to, __global const float* restrict b, int pitch, int depth, int columns) {
  for (int k = 0; k < depth; k++)
    for (int j = 0; j < NR; j++) to[k * NR + j] = j < columns ? b[(size_t)k * pitch + j] : 0.0f;
}
#endif

#if A_PACKED
// AB rows of A or what is left, as panels [KC][MR] with a pitch of PANEL; zeros up to a whole panel.
static inline void pack_a(__local float* restrict to, __global const float* restrict a, int pitch, int depth, int rows) {
  for (int k = 0; k < depth; k++) {
    __global const float* from = a + (size_t)k * pitch;
    int i = 0;
    for (; i + AB <= rows; i += AB)
      UNROLL for (int p = 0; p < AB; p += 4) vstore4(vload4(0, from + p), 0, to + p / MR * PANEL + k * MR + p % MR);
    for (; i < (rows + MR - 1) / MR * MR; i++) to[i / MR * PANEL + k * MR + i % MR] = i < rows ? from[i] : 0.0f;
  }
}
#endif

// What ends a sum (prelude.cl): `flags` 0 where this is not its last block. bias of the tile's columns, residual of its
// elements.
struct Ending {
  int flags;
  __global const float* bias;
  __global const float* residual;
};

// Where the tile lies in C: beyond `rows` and `columns` nothing is read or stored.
struct Place {
  __global float* c;
  int pitch, rows, columns;
};

INLINE void load_tile(float16 acc[MR][NV], const struct Place p, __local float* edge) {
  if (p.rows >= MR && p.columns >= NR) {
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] =
        vload16(v, p.c + (size_t)i * p.pitch);
  } else {
    for (int i = 0; i < min(p.rows, MR); i++)
      for (int j = 0; j < min(p.columns, NR); j++) edge[i * NR + j] = p.c[(size_t)i * p.pitch + j];
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = vload16(v, edge + i * NR);
  }
}

INLINE void store_tile(float16 acc[MR][NV], const struct Place p, const struct Ending end, __local float* edge) {
  const int rows = min(p.rows, MR), columns = min(p.columns, NR);
  if (rows == MR && columns == NR) {
    if (end.flags & EPILOGUE_BIAS) {
      UNROLL for (int v = 0; v < NV; v++) {
        const float16 bias = vload16(v, end.bias);
        UNROLL for (int i = 0; i < MR; i++) acc[i][v] += bias;
      }
    }
    if (end.flags & EPILOGUE_RESIDUAL) {
      UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] +=
          vload16(v, end.residual + (size_t)i * p.pitch);
    }
    if (end.flags & EPILOGUE_RELU) {
      UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = fmax(acc[i][v], 0.0f);
    }
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++)
        store16(acc[i][v], p.c + (size_t)i * p.pitch + v * 16);
  } else {
    UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) vstore16(acc[i][v], v, edge + i * NR);
    for (int i = 0; i < rows; i++)
      for (int j = 0; j < columns; j++) {
        float y = edge[i * NR + j];
        if (end.flags & EPILOGUE_BIAS) y += end.bias[j];
        if (end.flags & EPILOGUE_RESIDUAL) y += end.residual[(size_t)i * p.pitch + j];
        p.c[(size_t)i * p.pitch + j] = end.flags & EPILOGUE_RELU ? fmax(y, 0.0f) : y;
      }
  }
  if (end.flags & EPILOGUE_SILU)  // in memory: it would not fit beside the tile
    for (int i = 0; i < rows; i++)
      for (int j = 0; j < columns; j++)
        p.c[(size_t)i * p.pitch + j] = activate(p.c[(size_t)i * p.pitch + j], EPILOGUE_SILU);
}

// What the next tiles will read is brought into the cache while this one is computed. At every 16th k: MR lines of A,
// NV of B and NV of C, `line` floats apart, those of the next time `step` further on, until `last`. Without a branch:
// one too many costs nothing.
struct Lines {
  __global const float* from;
  int step, line, last;
};
struct Ahead {
  struct Lines a, b, c;
};

INLINE __global const float* lines_at(const struct Lines l, int time) {
  return l.from + (size_t)min(time, l.last) * l.step;
}

INLINE void fetch(const struct Ahead next, int time) {
  __global const float* a = lines_at(next.a, time);
  UNROLL for (int i = 0; i < MR; i++) PREFETCH(a + (size_t)i * next.a.line);
  __global const float* b = lines_at(next.b, time);
  UNROLL for (int v = 0; v < NV; v++) PREFETCH(b + (size_t)v * next.b.line);
  __global const float* c = lines_at(next.c, time);
  UNROLL for (int v = 0; v < NV; v++) PREFETCH_WRITE(c + v * 16);
}

// Lines across `rows` rows of a matrix from row `first` on, or none that are new.
INLINE struct Lines across(__global const float* from, int pitch, int first, int rows) {
  const struct Lines l = {from + (rows > 0 ? (size_t)first * pitch : 0), rows > 0 ? pitch : 0, 16,
                          rows > 0 ? rows - 1 : 0};
  return l;
}

INLINE void multiply(float16 acc[MR][NV], A_SPACE const float* restrict a, const int* at, const float16 row[NV],
                            size_t k) {
  UNROLL for (int i = 0; i < MR; i++) {
    const float16 x = (float16)(a[at[i] + k]);
    UNROLL for (int v = 0; v < NV; v++) acc[i][v] += x * row[v];
  }
}

// C tile (+)= A * packed panel of B.
static inline void micro_tile(A_SPACE const float* restrict a, const int* at, int a_step, __local const float* restrict b,
                              int depth, int add, const struct Place place, const struct Ending end,
                              __local float* restrict edge, const struct Ahead next) {
  float16 acc[MR][NV];
  UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = (float16)(0.0f);
  if (add) load_tile(acc, place, edge);
  const int steps = depth / 16;
  for (int step = 0; step < steps; step++) {
    fetch(next, step);
#pragma unroll 4
    for (int k = step * 16; k < step * 16 + 16; k++) {
      float16 row[NV];
      UNROLL for (int v = 0; v < NV; v++) row[v] = vload16(v, b + k * NR);
      multiply(acc, a, at, row, (size_t)k * a_step);
    }
  }
#pragma unroll 1
  for (int k = steps * 16; k < depth; k++) {
    float16 row[NV];
    UNROLL for (int v = 0; v < NV; v++) row[v] = vload16(v, b + k * NR);
    multiply(acc, a, at, row, (size_t)k * a_step);
  }
  store_tile(acc, place, end, edge);
}

#if !B_BY_COLUMN
// The same, with B read where it lies, and packed in passing.
static inline void micro_tile_packing(A_SPACE const float* restrict a, const int* at, int a_step,
                                      __global const float* restrict from, int pitch, __local float* restrict b, int depth,
                                      int add, const struct Place place, const struct Ending end, __local float* restrict edge,
                                      const struct Ahead next) {
  float16 acc[MR][NV];
  UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = (float16)(0.0f);
  if (add) load_tile(acc, place, edge);
  for (int step = 0; step < (depth + 15) / 16; step++) {
    fetch(next, step);
#pragma unroll 2
    for (int k = step * 16; k < min(step * 16 + 16, depth); k++) {
      float16 row[NV];
      UNROLL for (int v = 0; v < NV; v++) row[v] = vload16(v, from + (size_t)k * pitch);
      UNROLL for (int v = 0; v < NV; v++) PREFETCH(from + (size_t)(k + 16) * pitch + v * 16);
      UNROLL for (int v = 0; v < NV; v++) store16(row[v], b + k * NR + v * 16);
      multiply(acc, a, at, row, (size_t)k * a_step);
    }
  }
  store_tile(acc, place, end, edge);
}
#endif

// Group (x, y, z): columns from x * nc, rows from y * mc, z = batch * splits + split. A split sums k_each of the depth
// into its own c[z]; add_splits joins them. nc <= NC.
FAT __kernel void matmul_blocked(__global const float* restrict a, int a_offset, __global const float* restrict b,
                                 int b_offset, __global float* restrict c, int m, int n, int depth, int a_batch,
                                 int a_pitch, int b_batch, int b_pitch, int mc, int nc, int splits, int k_each,
                                 __global const float* restrict bias, __global const float* restrict residual,
                                 int epilogue) {
  __local float b_block[KC * NC] __attribute__((aligned(64)));
#if A_PACKED
  __local float a_block[AB / MR * PANEL] __attribute__((aligned(64)));
#endif
  __local float edge[MR * NR] __attribute__((aligned(64)));
  const int z = get_group_id(2), batch = z / splits;
  const int j0 = get_group_id(0) * nc, columns = min(nc, n - j0), tiles = (columns + NR - 1) / NR;
  const int i0 = get_group_id(1) * mc, i_end = min(m, i0 + mc), panels = (i_end - i0 + MR - 1) / MR;
  const int k_begin = (z - batch * splits) * k_each, k_end = min(depth, k_begin + k_each);
  a += a_offset + (size_t)batch * a_batch;
  b += b_offset + (size_t)batch * b_batch;
  c += (size_t)z * m * n;
  residual += (size_t)batch * m * n;
  const int a_row = A_BY_COLUMN ? 1 : a_pitch, a_column = A_BY_COLUMN ? a_pitch : 1;
  const int b_row = B_BY_COLUMN ? 1 : b_pitch, b_column = B_BY_COLUMN ? b_pitch : 1;
  const int b_each = (KC + panels - 1) / panels;  // rows of the next block of B that a row of tiles fetches
  const int a_each = (KC - 1) / (tiles * (A_PACKED ? AB / MR : panels)) + 1;
  for (int k0 = k_begin; k0 < k_end; k0 += KC) {
    const int kc = min(KC, k_end - k0), add = k0 > k_begin, down = k0 + KC < depth;
    const int flags = k0 + KC < k_end ? 0 : epilogue;
    // The block of B that comes next: further down, or the first one of the next group.
    const int next_k = down ? k0 + kc : k_begin, next_j = down ? j0 : j0 + nc;
    const int k_left = next_j < n ? min(KC, depth - next_k) : 0;
    __global const float* next_b = b + (size_t)next_k * b_row + (size_t)next_j * b_column;
    for (int ib = i0; ib < i_end; ib += AB) {
#if A_PACKED
      pack_a(a_block, a + (size_t)k0 * a_pitch + ib, a_pitch, kc, min(AB, i_end - ib));
#endif
      for (int i = ib; i < min(i_end, ib + AB); i += MR) {
        int at[MR];  // of the last rows there may be fewer: they are read again, and not stored
#if A_PACKED
        __local const float* rows = a_block + (i - ib) / MR * PANEL;
        UNROLL for (int q = 0; q < MR; q++) at[q] = q;
#else
        __global const float* rows = a + (size_t)i * a_row + (size_t)k0 * a_column;
        UNROLL for (int q = 0; q < MR; q++) at[q] = min(q, m - 1 - i) * a_row;
#endif
        for (int j = 0; j < columns; j += NR) {
          __local float* panel = b_block + (j / NR) * (KC * NR);
          const size_t to = (size_t)i * n + j0 + j;
          const struct Place place = {c + to, n, i_end - i, columns - j};
          const struct Ending end = {flags, bias + j0 + j, residual + to};
          struct Ahead next;
          const int below = i + 2 * MR <= i_end;  // there is a whole panel of A after this one
          next.c = across(j + NR < columns ? place.c + NR : below ? c + (size_t)(i + MR) * n + j0 : place.c, n, 0, MR);
#if B_BY_COLUMN
          const int column = min((i - i0) / MR * NV, nc - NV);
          const struct Lines b_lines = {next_b + (size_t)(column + j) * b_pitch, 16, b_pitch, k_left / 16};
          next.b = b_lines;
#else
          const int b_first = (i - i0) / MR * b_each;
          next.b = across(next_b + j, b_pitch, b_first, min(b_each, k_left - b_first));
#endif
#if A_PACKED
          const int a_first = ((i - ib) / MR * tiles + j / NR) * a_each, more = ib + AB < i_end;
          next.a = across(a + (size_t)(more ? k0 : next_k) * a_pitch + (more ? ib + AB : i0), a_pitch, a_first,
                          min(a_each, (more ? kc : k_left) - a_first));
#elif A_BY_COLUMN
          const int a_first = ((i - i0) / MR * tiles + j / NR) * a_each;
          next.a = across(a + (size_t)next_k * a_pitch + i0, a_pitch, a_first, min(a_each, k_left - a_first));
#else
          const struct Lines a_lines = {rows + (below ? (size_t)MR * a_pitch : 0), 16, a_pitch, kc / 16};
          next.a = a_lines;
#endif
          if (i == i0) {
#if B_BY_COLUMN
            pack_b(panel, b + (size_t)(j0 + j) * b_pitch + k0, b_pitch, kc, columns - j);
#else
            __global const float* from = b + (size_t)k0 * b_pitch + j0 + j;
            if (columns - j >= NR) {
              micro_tile_packing(rows, at, A_STEP(a_pitch), from, b_pitch, panel, kc, add, place, end, edge, next);
              continue;
            }
            pack_b(panel, from, b_pitch, kc, columns - j);
#endif
          }
          micro_tile(rows, at, A_STEP(a_pitch), panel, kc, add, place, end, edge, next);
        }
      }
    }
  }
}

// c[b][i][j] = end of sum over s of parts[b][s][i][j], in the order of s; `chunk` rows a group.
FAT __kernel void add_splits(__global const float* restrict parts, __global float* restrict c, int m, int n, int splits,
                             int chunk, __global const float* restrict bias, __global const float* restrict residual,
                             int epilogue) {
  const size_t batch = get_group_id(1), count = (size_t)m * n;
  parts += batch * splits * count;
  c += batch * count;
  residual += batch * count;
  const int end = min(m, ((int)get_group_id(0) + 1) * chunk);
  for (int i = get_group_id(0) * chunk; i < end; i++)
    for (int j0 = 0; j0 < n; j0 += 16) {
      const size_t e = (size_t)i * n + j0;
      const int columns = min(16, n - j0);
      float sum[16];
      for (int j = 0; j < columns; j++) sum[j] = parts[e + j];
      for (int s = 1; s < splits; s++)
        if (columns == 16)
          for (int j = 0; j < 16; j++) sum[j] += parts[s * count + e + j];
        else
          for (int j = 0; j < columns; j++) sum[j] += parts[s * count + e + j];
      for (int j = 0; j < columns; j++) {
        if (epilogue & EPILOGUE_BIAS) sum[j] += bias[j0 + j];
        if (epilogue & EPILOGUE_RESIDUAL) sum[j] += residual[e + j];
        c[e + j] = activate(sum[j], epilogue);
      }
    }
}
