// Which tiles of 16 x 16 pixels each projected gaussian reaches: those where its alpha is 1/255 or more somewhere between
// the tile's outermost pixel centres. That region is an ellipse a dx^2 + 2 b dx dy + c dy^2 <= 2 ln(255 opacity); a row
// of tiles cuts a band out of it, whose furthest points left and right tell the tiles.
// count_tiles and list_tiles must find the same tiles. So nothing in this file is contracted, since a compiler may turn
// a * b + c into a fused operation in one kernel and not in the other; and as m_log, from the prelude, may be, list_tiles
// keeps to its share whatever it finds.
#pragma OPENCL FP_CONTRACT OFF
#define TILE 16

typedef struct {
  float x, y, a, b, c, level, half_width, half_height;
} Ellipse;

// half_height < 0: nowhere.
static inline Ellipse ellipse_of(__global const float* s) {
  Ellipse e = {s[0], s[1], s[2], s[3], s[4], 2.0f * m_log(fmax(s[5], 1e-30f) * 255.0f) * 1.0001f + 1e-4f, -1.0f, -1.0f};
  const float determinant = e.a * e.c - e.b * e.b;
  if (!(e.level > 0.0f) || !isfinite(e.x) || !isfinite(e.y)) return e;
  const int bounded = e.a > 0.0f && determinant > 1e-6f * e.a * e.c;
  e.half_width = bounded ? sqrt(e.level * e.c / determinant) : 1e9f;
  e.half_height = bounded ? sqrt(e.level * e.a / determinant) : 1e9f;
  return e;
}

// The first and last tile along an axis of `tiles`, whose outermost pixel centres [low, high] reaches; first > last: none.
static inline int2 tiles_between(float low, float high, int tiles) {
  const float most = (float)tiles;
  return (int2)((int)clamp(ceil((low - 15.5f) / TILE), 0.0f, most), (int)clamp(floor((high - 0.5f) / TILE), -1.0f, most - 1.0f));
}

// Of the ellipse between dy = low and dy = high: how far it reaches to the side `sign`. Its point furthest to that side
// lies at dy = -sign b / c half_width; where the band leaves that out, at the band's nearer end.
static inline float reach(Ellipse e, float low, float high, float sign) {
  if (e.half_width > 1e8f) return e.half_width;
  const float dy = clamp(-sign * e.b / e.c * e.half_width, low, high);
  const float under = fmax(0.0f, e.b * e.b * dy * dy - e.a * (e.c * dy * dy - e.level));
  return (sqrt(under) - sign * e.b * dy) / e.a * 1.0001f + 1e-3f;
}

static inline int2 tiles_in_row(Ellipse e, int row, int across) {
  const float top = (float)(row * TILE) + 0.5f - e.y;
  const float low = fmax(top, -e.half_height), high = fmin(top + 15.0f, e.half_height);
  return tiles_between(e.x - reach(e, low, high, -1.0f), e.x + reach(e, low, high, 1.0f), across);
}

// splats [G,7] of kernels/splat_project.cl -> counts [G], of tiles.
__kernel FAT void count_tiles(__global const float* restrict splats, __global int* restrict counts, int count, int across,
                              int down, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    const Ellipse e = ellipse_of(splats + 7 * (size_t)i);
    int all = 0;
    if (e.half_height >= 0.0f) {
      const int2 rows = tiles_between(e.y - e.half_height, e.y + e.half_height, down);
      for (int row = rows.x; row <= rows.y; row++) {
        const int2 span = tiles_in_row(e, row, across);
        all += max(0, span.y - span.x + 1);
      }
    }
    counts[i] = all;
  }
}

// order [G]: gaussians from near to far; starts [G+1]: where the k-th of them begins; slots [G+1]: where gaussian i does
// when they are listed by number. -> tiles, slot and gaussian of each pair.
__kernel FAT void list_tiles(__global const float* restrict splats, __global const int* restrict order,
                             __global const int* restrict starts, __global const int* restrict slots,
                             __global int* restrict tiles, __global int* restrict slot_of, __global int* restrict owner,
                             int count, int across, int down, int chunk) {
  for (int k = LOOP_LO(chunk); k < LOOP_HI(count, chunk); k += LOOP_STEP) {
    const int i = order[k];
    const int end = starts[k + 1];
    int at = starts[k], slot = slots[i];
    if (at == end) continue;
    const Ellipse e = ellipse_of(splats + 7 * (size_t)i);
    const int2 rows = tiles_between(e.y - e.half_height, e.y + e.half_height, down);
    for (int row = rows.x; row <= rows.y; row++) {
      const int2 span = tiles_in_row(e, row, across);
      for (int column = span.x; column <= span.y && at < end; column++) {
        tiles[at] = row * across + column;
        slot_of[at++] = slot;
        owner[slot++] = i;
      }
    }
    for (; at < end; at++) {  // fewer than were counted: the first tile, where the gaussian blends by its own alpha
      tiles[at] = 0;
      slot_of[at] = slot;
      owner[slot++] = i;
    }
  }
}
