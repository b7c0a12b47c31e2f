// Multiresolution hash grid (Mueller et al. 2022): points [S,3] in [0,1]^3, table [LEVELS * rows, FEATURES]
// -> [S, LEVELS * FEATURES]. Cell corners index a dense grid while it fits `rows`, else a spatial hash.
// hash_grid: version 1 and fast alike (a work-item: a chunk of samples at one level, so that a level's table stays in
// cache). Gradient, two forms: version 1 lists (row, weight * g) pairs for a deterministic scatter; version 2 (CPU) gives
// each work-item one part of one level's table and lets it walk all samples in order: no atomics, one order of summation.
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

inline Cell cell_at(__global const float* restrict points, int s, float resolution) {
  const float3 p = vload3(s, points) * resolution;
  const float3 base = clamp(floor(p), 0.0f, resolution - 1.0f);
  Cell c;
  c.x = (uint)base.x;
  c.y = (uint)base.y;
  c.z = (uint)base.z;
  c.f = p - base;
  return c;
}

// Rows of the eight corners (bit 0: x, bit 1: y, bit 2: z). `side` = resolution + 1 corners an axis; 0: the level is hashed.
inline void corner_rows(Cell c, uint side, uint rows, uint row[8]) {
  if (side) {
    const uint base = c.x + side * (c.y + side * c.z);
    UNROLL for (int k = 0; k < 8; k++) row[k] = base + (k & 1) + ((k >> 1 & 1) + (k >> 2) * side) * side;
  } else {
    const uint y0 = c.y * 2654435761u, z0 = c.z * 805459861u, mask = rows - 1;
    UNROLL for (int k = 0; k < 8; k++)
      row[k] = ((c.x + (k & 1)) ^ (y0 + (k >> 1 & 1) * 2654435761u) ^ (z0 + (k >> 2) * 805459861u)) & mask;
  }
}

inline float corner_weight(Cell c, int corner) {
  return ((corner & 1) ? c.f.x : 1.0f - c.f.x) * ((corner & 2) ? c.f.y : 1.0f - c.f.y) * ((corner & 4) ? c.f.z : 1.0f - c.f.z);
}

// levels: per level resolution and side.
FAT __kernel void hash_grid(__global const float* restrict points, __global const float* restrict table, __global const int* restrict levels,
                            __global float* restrict out, int n, int rows, int level_count, int chunk) {
  const int level = get_global_id(1);
  const float resolution = (float)levels[2 * level];
  const uint side = (uint)levels[2 * level + 1];
  __global const float* restrict t = table + (size_t)level * rows * FEATURES;
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    const Cell c = cell_at(points, s, resolution);
    uint row[8];
    corner_rows(c, side, (uint)rows, row);
    feature v[8];
    UNROLL for (int k = 0; k < 8; k++) v[k] = LOAD(row[k], t);
    UNROLL for (int k = 0; k < 8; k += 2) v[k] += c.f.x * (v[k + 1] - v[k]);
    const feature low = v[0] + c.f.y * (v[2] - v[0]), high = v[4] + c.f.y * (v[6] - v[4]);
    STORE(low + c.f.z * (high - low), s * level_count + level, out);
  }
}

// dtable[row] += w * g for the rows [part, part + 1) / parts of one level.
FAT __kernel void hash_grid_dtable(__global const float* restrict points, __global const float* restrict g, __global const int* restrict levels,
                                   __global float* restrict dtable, int n, int rows, int level_count, int parts) {
  const int level = get_global_id(0) / parts, part = get_global_id(0) % parts;
  const float resolution = (float)levels[2 * level];
  const uint side = (uint)levels[2 * level + 1];
  const uint part_rows = ((uint)rows + parts - 1) / parts, lo = part * part_rows, hi = min((uint)rows, lo + part_rows);
  __global float* restrict t = dtable + (size_t)level * rows * FEATURES;
  for (uint i = lo * FEATURES; i < hi * FEATURES; i++) t[i] = 0.0f;
  for (int s = 0; s < n; s++) {
    const Cell c = cell_at(points, s, resolution);
    const feature gs = LOAD(s * level_count + level, g);
    uint row[8];
    corner_rows(c, side, (uint)rows, row);
    if (parts == 1) {
      UNROLL for (int k = 0; k < 8; k++) STORE(LOAD(row[k], t) + corner_weight(c, k) * gs, row[k], t);
    } else {
      UNROLL for (int k = 0; k < 8; k++)
        if (row[k] >= lo && row[k] < hi) STORE(LOAD(row[k], t) + corner_weight(c, k) * gs, row[k], t);
    }
  }
}

// Pairs for the scatter: row_of [S * level_count * 8], value [S * level_count * 8, FEATURES].
__kernel void hash_grid_pairs(__global const float* restrict points, __global const float* restrict g, __global const int* restrict levels,
                              __global int* restrict row_of, __global float* restrict value, int n, int rows, int level_count) {
  const int item = get_global_id(0);
  if (item >= n * level_count) return;
  const int s = item / level_count, level = item % level_count;
  const Cell c = cell_at(points, s, (float)levels[2 * level]);
  const feature gs = LOAD(item, g);
  uint row[8];
  corner_rows(c, (uint)levels[2 * level + 1], (uint)rows, row);
  for (int k = 0; k < 8; k++) {
    row_of[item * 8 + k] = level * rows + (int)row[k];
    STORE(corner_weight(c, k) * gs, item * 8 + k, value);
  }
}

// dpoints [S,3]: derivative of the trilinear weights along each axis.
FAT __kernel void hash_grid_dpoints(__global const float* restrict points, __global const float* restrict table, __global const int* restrict levels,
                                    __global const float* restrict g, __global float* restrict dpoints, int n, int rows, int level_count, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    float3 total = (float3)(0.0f);
    for (int level = 0; level < level_count; level++) {
      const float resolution = (float)levels[2 * level];
      const Cell c = cell_at(points, s, resolution);
      const feature gs = LOAD(s * level_count + level, g);
      uint row[8];
      corner_rows(c, (uint)levels[2 * level + 1], (uint)rows, row);
      for (int k = 0; k < 8; k++) {
        const float v = resolution * DOT(gs, LOAD(row[k], table + (size_t)level * rows * FEATURES));
        const float wx = (k & 1) ? c.f.x : 1.0f - c.f.x, wy = (k & 2) ? c.f.y : 1.0f - c.f.y, wz = (k & 4) ? c.f.z : 1.0f - c.f.z;
        total += v * (float3)((k & 1) ? wy * wz : -wy * wz, (k & 2) ? wx * wz : -wx * wz, (k & 4) ? wx * wy : -wx * wy);
      }
    }
    vstore3(total, s, dpoints);
  }
}
