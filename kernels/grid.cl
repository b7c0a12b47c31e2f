// Multiresolution hash grid (Mueller et al. 2022): points [S,3] in [0,1]^3, table [LEVELS, owned, rows, FEATURES]
// -> [S, LEVELS * FEATURES]. Cell corners index a dense grid while it fits `rows`, else a spatial hash. owners [S] says
// whose rows a sample reads (owned 1: there is one owner, and owners is not read).
// hash_grid, version 1: a work-item takes a chunk of samples at one level, so that a level's table stays in cache. Its
// gradient lists (row, weight * g) pairs for a deterministic scatter.
// hash_grid_blocks, for CPU devices: the rows of a block of samples are computed as vectors and asked for before they are
// read; levels lie one after another and are joined at the end, because pieces of a row of results would each fetch a
// line. Its gradient gives each work-item one part of one level's table and lets it walk all samples in order: no atomics,
// one order of summation.
//: variant hash_grid reference any
//: variant hash_grid gpu any
//: variant hash_grid_blocks cpu any BLOCK=16
#if FEATURES == 4
typedef float4 feature;
#define LOAD(i, p) vload4(i, p)
#define STORE(v, i, p) vstore4(v, i, p)
#define DOT(a, b) dot(a, b)
#elif FEATURES == 2
typedef float2 feature;
#define LOAD(i, p) vload2(i, p)
#define STORE(v, i, p) vstore2(v, i, p)
#define DOT(a, b) dot(a, b)
#else
typedef float feature;
#define LOAD(i, p) (p)[i]
#define STORE(v, i, p) (p)[i] = (v)
#define DOT(a, b) ((a) * (b))
#endif

typedef struct {
  uint x, y, z;     // corner with the lowest coordinates
  float3 f;         // place inside the cell
} Cell;

static inline Cell cell_at(__global const float* restrict points, int s, float resolution) {
  const float3 p = vload3(s, points) * resolution;
  const float3 base = clamp(floor(p), 0.0f, resolution - 1.0f);
  Cell c;
  c.x = (uint)base.x;
  c.y = (uint)base.y;
  c.z = (uint)base.z;
  c.f = p - base;
  return c;
}

// The first of a sample's rows in a level.
static inline uint first_row(__global const int* restrict owners, int s, int owned, int rows) { return owned > 1 ? (uint)owners[s] * (uint)rows : 0; }

// Rows of the eight corners (bit 0: x, bit 1: y, bit 2: z). `side` = resolution + 1 corners an axis; 0: the level is hashed.
static inline void corner_rows(Cell c, uint side, uint rows, uint first, uint row[8]) {
  if (side) {
    const uint base = first + c.x + side * (c.y + side * c.z);
    UNROLL for (int k = 0; k < 8; k++) row[k] = base + (k & 1) + ((k >> 1 & 1) + (k >> 2) * side) * side;
  } else {
    const uint y0 = c.y * 2654435761u, z0 = c.z * 805459861u, mask = rows - 1;
    UNROLL for (int k = 0; k < 8; k++)
      row[k] = first + (((c.x + (k & 1)) ^ (y0 + (k >> 1 & 1) * 2654435761u) ^ (z0 + (k >> 2) * 805459861u)) & mask);
  }
}

static inline float corner_weight(Cell c, int corner) {
  return ((corner & 1) ? c.f.x : 1.0f - c.f.x) * ((corner & 2) ? c.f.y : 1.0f - c.f.y) * ((corner & 4) ? c.f.z : 1.0f - c.f.z);
}

// levels: per level resolution and side.
FAT __kernel void hash_grid(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict table,
                            __global const int* restrict levels, __global float* restrict out, int n, int owned, int rows, int level_count, int chunk) {
  const int level = get_global_id(1);
  const float resolution = (float)levels[2 * level];
  const uint side = (uint)levels[2 * level + 1];
  __global const float* restrict t = table + (size_t)level * owned * rows * FEATURES;
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    const Cell c = cell_at(points, s, resolution);
    uint row[8];
    corner_rows(c, side, (uint)rows, first_row(owners, s, owned, rows), row);
    feature v[8];
    UNROLL for (int k = 0; k < 8; k++) v[k] = LOAD(row[k], t);
    UNROLL for (int k = 0; k < 8; k += 2) v[k] += c.f.x * (v[k + 1] - v[k]);
    const feature low = v[0] + c.f.y * (v[2] - v[0]), high = v[4] + c.f.y * (v[6] - v[4]);
    STORE(low + c.f.z * (high - low), s * level_count + level, out);
  }
}

#ifdef BLOCK
typedef struct {
  uint row[8][BLOCK];
  float fx[BLOCK], fy[BLOCK], fz[BLOCK];
} Block;

// Of a level of the table; rows: of an owner.
typedef struct {
  int resolution, side, owned, rows;
} Level;

// Rows and places of samples [first, first + BLOCK), the last of them repeated beyond n; their rows are asked for.
static inline void find_block(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict table, int2 first_n, Level level, Block* restrict b) {
  const int first = first_n.x, last = first_n.y - 1, most = level.resolution - 1;
  const uint side = (uint)level.side, mask = (uint)level.rows - 1;
  const float resolution = (float)level.resolution;
  uint x[BLOCK], y[BLOCK], z[BLOCK];
  float end[3 * BLOCK];
  const int whole = first + BLOCK <= last + 1;
  if (!whole)
    for (int i = 0; i < 3 * BLOCK; i++) end[i] = points[min(3 * first + i, 3 * last + i % 3)];
  // Three vectors of x y z x y z ... to one of each: loads of every third number would become slow gathers.
  const float16 p = resolution * (whole ? vload16(0, points + 3 * first) : vload16(0, end));
  const float16 q = resolution * (whole ? vload16(1, points + 3 * first) : vload16(1, end));
  const float16 r = resolution * (whole ? vload16(2, points + 3 * first) : vload16(2, end));
  vstore16((float16)(p.s0369, p.scf, q.s258b, q.se, r.s147a, r.sd), 0, b->fx);
  vstore16((float16)(p.s147a, p.sd, q.s0369, q.scf, r.s258b, r.se), 0, b->fy);
  vstore16((float16)(p.s258b, p.se, q.s147a, q.sd, r.s0369, r.scf), 0, b->fz);
  for (int i = 0; i < BLOCK; i++) {
    const int cx = clamp((int)b->fx[i], 0, most), cy = clamp((int)b->fy[i], 0, most), cz = clamp((int)b->fz[i], 0, most);
    b->fx[i] -= (float)cx;
    b->fy[i] -= (float)cy;
    b->fz[i] -= (float)cz;
    x[i] = (uint)cx;
    y[i] = (uint)cy;
    z[i] = (uint)cz;
  }
  UNROLL for (int k = 0; k < 8; k++) {
    const uint dx = k & 1, dy = k >> 1 & 1, dz = k >> 2;
    if (side)
      for (int i = 0; i < BLOCK; i++) b->row[k][i] = x[i] + dx + side * (y[i] + dy + side * (z[i] + dz));
    else
      for (int i = 0; i < BLOCK; i++) b->row[k][i] = ((x[i] + dx) ^ (y[i] + dy) * 2654435761u ^ (z[i] + dz) * 805459861u) & mask;
  }
  if (level.owned > 1)
    for (int i = 0; i < BLOCK; i++) {
      const uint of_owner = first_row(owners, min(first + i, last), level.owned, level.rows);
      UNROLL for (int k = 0; k < 8; k++) b->row[k][i] += of_owner;
    }
  for (int i = 0; i < BLOCK; i++)
    UNROLL for (int k = 0; k < 8; k += 2) __builtin_prefetch(table + b->row[k][i] * FEATURES);
}

// by_level [LEVELS][n][FEATURES]; work-items: chunks of samples x levels.
FAT __kernel void hash_grid_blocks(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict table,
                                   __global const int* restrict levels, __global float* restrict by_level, int n, int owned, int rows, int chunk) {
  const int level = get_global_id(1);
  const Level form = {levels[2 * level], levels[2 * level + 1], owned, rows};
  __global const float* restrict t = table + (size_t)level * owned * rows * FEATURES;
  __global float* restrict out = by_level + (size_t)level * n * FEATURES;
  const int begin = get_global_id(0) * chunk, end = min(n, begin + chunk);
  Block b[2];
  if (begin < end) find_block(points, owners, t, (int2)(begin, n), form, b);
  for (int first = begin, turn = 0; first < end; first += BLOCK, turn ^= 1) {
    if (first + BLOCK < end) find_block(points, owners, t, (int2)(first + BLOCK, n), form, b + (turn ^ 1));
    const Block* now = b + turn;
    for (int i = 0; i < min(BLOCK, end - first); i++) {
      feature v[8];
      UNROLL for (int k = 0; k < 8; k++) v[k] = LOAD(now->row[k][i], t);
      UNROLL for (int k = 0; k < 8; k += 2) v[k] += now->fx[i] * (v[k + 1] - v[k]);
      const feature low = v[0] + now->fy[i] * (v[2] - v[0]), high = v[4] + now->fy[i] * (v[6] - v[4]);
      STORE(low + now->fz[i] * (high - low), first + i, out);
    }
  }
}

// out [n, LEVELS * FEATURES] of by_level [LEVELS][n][FEATURES], and back: in blocks, so that lines are used whole.
FAT __kernel void hash_grid_join(__global const float* restrict by_level, __global float* restrict out, int n, int level_count, int chunk) {
  const int end = LOOP_HI(n, chunk);
  for (int first = LOOP_LO(chunk); first < end; first += BLOCK)
    for (int l = 0; l < level_count; l++)
      for (int s = first; s < min(end, first + BLOCK); s++)
        STORE(LOAD((size_t)l * n + s, by_level), (size_t)s * level_count + l, out);
}
FAT __kernel void hash_grid_split(__global const float* restrict g, __global float* restrict by_level, int n, int level_count, int chunk) {
  const int end = LOOP_HI(n, chunk);
  for (int first = LOOP_LO(chunk); first < end; first += BLOCK)
    for (int l = 0; l < level_count; l++)
      for (int s = first; s < min(end, first + BLOCK); s++)
        STORE(LOAD((size_t)s * level_count + l, g), (size_t)l * n + s, by_level);
}

// sparse: most of it is not added to, and need not lie in a cache.
static inline void clear(__global float* to, uint count, int sparse) {
  uint i = 0;
  if (sparse && ((size_t)to & 63) == 0)
    for (; i + 16 <= count; i += 16) STORE_PAST_CACHES((float16)(0.0f), (__global float16*)(to + i));
  for (; i < count; i++) to[i] = 0.0f;
}

// dtable[row] += w * g for the rows [part, part + 1) / parts of one level, of all owners.
FAT __kernel void hash_grid_dtable(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict by_level,
                                   __global const int* restrict levels, __global float* restrict dtable, int n, int owned, int rows, int parts) {
  const int level = get_global_id(0) / parts, part = get_global_id(0) % parts;
  const Level form = {levels[2 * level], levels[2 * level + 1], owned, rows};
  const uint all = (uint)owned * (uint)rows, part_rows = (all + parts - 1) / parts, lo = min(all, part * part_rows), hi = min(all, lo + part_rows);
  __global float* restrict t = dtable + (size_t)level * all * FEATURES;
  __global const float* restrict g = by_level + (size_t)level * n * FEATURES;
  clear(t + (size_t)lo * FEATURES, (hi - lo) * FEATURES, 16 * n < all * FEATURES / 16);
  Block b[2];
  if (n > 0) find_block(points, owners, t, (int2)(0, n), form, b);
  for (int first = 0, turn = 0; first < n; first += BLOCK, turn ^= 1) {
    if (first + BLOCK < n) find_block(points, owners, t, (int2)(first + BLOCK, n), form, b + (turn ^ 1));
    const Block* now = b + turn;
    for (int i = 0; i < min(BLOCK, n - first); i++) {
      const feature gs = LOAD(first + i, g);
      const Cell c = {0, 0, 0, (float3)(now->fx[i], now->fy[i], now->fz[i])};
      UNROLL for (int k = 0; k < 8; k++) {
        const uint row = now->row[k][i];
        if (parts == 1 || (row >= lo && row < hi)) STORE(LOAD(row, t) + corner_weight(c, k) * gs, row, t);
      }
    }
  }
}
#endif

// Pairs for the scatter: row_of [S * level_count * 8], value [S * level_count * 8, FEATURES].
__kernel void hash_grid_pairs(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict g,
                              __global const int* restrict levels, __global int* restrict row_of, __global float* restrict value, int n, int owned,
                              int rows, int level_count) {
  const int item = get_global_id(0);
  if (item >= n * level_count) return;
  const int s = item / level_count, level = item % level_count;
  const Cell c = cell_at(points, s, (float)levels[2 * level]);
  const feature gs = LOAD(item, g);
  uint row[8];
  corner_rows(c, (uint)levels[2 * level + 1], (uint)rows, first_row(owners, s, owned, rows), row);
  for (int k = 0; k < 8; k++) {
    row_of[item * 8 + k] = level * owned * rows + (int)row[k];
    STORE(corner_weight(c, k) * gs, item * 8 + k, value);
  }
}

// dpoints [S,3]: derivative of the trilinear weights along each axis.
FAT __kernel void hash_grid_dpoints(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict table,
                                    __global const int* restrict levels, __global const float* restrict g, __global float* restrict dpoints, int n,
                                    int owned, int rows, int level_count, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    float3 total = (float3)(0.0f);
    for (int level = 0; level < level_count; level++) {
      const float resolution = (float)levels[2 * level];
      const Cell c = cell_at(points, s, resolution);
      const feature gs = LOAD(s * level_count + level, g);
      uint row[8];
      corner_rows(c, (uint)levels[2 * level + 1], (uint)rows, first_row(owners, s, owned, rows), row);
      for (int k = 0; k < 8; k++) {
        const float v = resolution * DOT(gs, LOAD(row[k], table + (size_t)level * owned * rows * FEATURES));
        const float wx = (k & 1) ? c.f.x : 1.0f - c.f.x, wy = (k & 2) ? c.f.y : 1.0f - c.f.y, wz = (k & 4) ? c.f.z : 1.0f - c.f.z;
        total += v * (float3)((k & 1) ? wy * wz : -wy * wz, (k & 2) ? wx * wz : -wx * wz, (k & 4) ? wx * wy : -wx * wy);
      }
    }
    vstore3(total, s, dpoints);
  }
}
