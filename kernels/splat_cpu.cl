// Blending of 2D Gaussians (kernels/splat.cl says what is computed) on CPU devices. A work-item is a tile; the 16 pixels
// of a row are one vector, conditions are masks. A gaussian visits the rows that it reaches; the pixels' state stays in
// the core's first cache. A pixel that is done carries -T.
//: variant blend_rows cpu forward
//: variant gradient_rows cpu gradient
#define TILE 16
#define LEAST_ALPHA (1.0f / 255.0f)
#define LEAST_THROUGH 1e-4f
#ifndef MORE
#define MORE 0  // channels besides the colour
#endif

// A gaussian as a cache line: x, y, then -a/2, -b, -c/2 times log2 e (powers are of 2), opacity, colour, how far up and
// down and to the sides alpha is 1/255 or more, further channels. At dy the power is highest where its slope along x is 0, there
// -1/2 dy^2 det / a.
#define RECORD 16
#define PAIR 16
#define LOG2_E 1.44269504089f

__kernel FAT void splat_records(__global const float* restrict splats, __global const float* restrict colours,
                                __global float* restrict records, int count, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global float* to = records + RECORD * (size_t)i;
    __global const float* s = splats + 7 * (size_t)i;
    const float a = s[2], b = s[3], c = s[4], determinant = a * c - b * b;
    const float fall = 2.0f * m_log(s[5] * 255.0f) * 1.0001f + 1e-4f;  // 2 * (the lowest power still seen)
    const int bounded = a > 0.0f && determinant > 1e-6f * a * c;
    to[0] = s[0];
    to[1] = s[1];
    to[2] = -0.5f * LOG2_E * a;
    to[3] = -LOG2_E * b;
    to[4] = -0.5f * LOG2_E * c;
    to[5] = s[5];
    __global const float* colour = colours + (3 + MORE) * (size_t)i;
    to[6] = colour[0];
    to[7] = colour[1];
    to[8] = colour[2];
    UNROLL for (int m = 0; m < MORE; m++) to[11 + m] = colour[3 + m];
    to[9] = !(fall > 0.0f) ? -1.0f : (bounded ? sqrt(fall * a / determinant) : 1e9f);
    to[10] = !(fall > 0.0f) ? -1.0f : (bounded ? sqrt(fall * c / determinant) : 1e9f);
  }
}

// 2^x for x <= 0; below -125 about 2e-38.
INLINE float16 exp2_below(float16 x) {
  const float16 c = fmax(x, (float16)(-125.0f)), t = c + 12582912.0f;
  return m_exp2_parts16(t, c - (t - 12582912.0f));
}

// The sums over the lanes of 16 vectors, in four rounds that halve the lanes of each.
INLINE float16 halves(float16 a, float16 b) { return (float16)(a.lo, b.lo) + (float16)(a.hi, b.hi); }
INLINE float16 quarters(float16 a, float16 b) {
  return (float16)(a.s012389ab, b.s012389ab) + (float16)(a.s4567cdef, b.s4567cdef);
}
INLINE float16 eighths(float16 a, float16 b) {
  return (float16)(a.s014589cd, b.s014589cd) + (float16)(a.s2367abef, b.s2367abef);
}
INLINE float16 lanes(float16 a, float16 b) { return (float16)(a.even, b.even) + (float16)(a.odd, b.odd); }

static inline float16 centres(int left) {
  return (float16)(0.5f, 1.5f, 2.5f, 3.5f, 4.5f, 5.5f, 6.5f, 7.5f, 8.5f, 9.5f, 10.5f, 11.5f, 12.5f, 13.5f, 14.5f, 15.5f) + (float)left;
}

// Those of the rows [s0, s1) of a tile that a gaussian reaches: none where it lies to the side.
static inline int2 rows_reached(__global const float* s, int left, int top, int2 rows) {
  const float middle = s[0] - (float)(left + TILE / 2), above = s[1] - s[9] - (float)top, below = s[1] + s[9] - (float)top;
  if (fabs(middle) > s[10] + (float)(TILE / 2) || s[9] < 0.0f) return (int2)(0, 0);
  return (int2)(max(rows.x, (int)clamp(above, 0.0f, (float)TILE)), min(rows.y, (int)clamp(below + 1.0f, 0.0f, (float)TILE)));
}

// The rows [s0, s1) less those at either end where every pixel is done.
static inline int2 open_rows(int2 rows, const float16* through) {
  while (rows.x < rows.y && !any(through[rows.x] > 0.0f)) rows.x++;
  while (rows.x < rows.y && !any(through[rows.y - 1] > 0.0f)) rows.y--;
  return rows;
}

// Gaussians lie anywhere: a record that no cache holds would be waited for longer than its pixels take.
#define AHEAD 8
static inline void ask_ahead(__global const float* records, __global const int* ids, int k, int end) {
  __builtin_prefetch(records + RECORD * (size_t)ids[min(k + AHEAD, end - 1)]);
}

static inline float16 load_row(__global const float* from, int count) { return read_first(from, TILE, count); }

__kernel FAT void blend_rows(__global const float* restrict records, __global const int* restrict ids,
                             __global const int* restrict offsets, __global float* restrict out, int height, int width) {
  const int across = (width + TILE - 1) / TILE, tile = get_global_id(0), plane = height * width;
  const int left = tile % across * TILE, top = tile / across * TILE, rows = min(TILE, height - top);
  const float16 px = centres(left);
  float16 through[TILE], red[TILE], green[TILE], blue[TILE];
#if MORE
  float16 more[MORE][TILE];
#endif
  for (int y = 0; y < TILE; y++) {
    through[y] = (float16)(y < rows ? 1.0f : -1.0f);
    red[y] = green[y] = blue[y] = (float16)(0.0f);
#if MORE
    UNROLL for (int m = 0; m < MORE; m++) more[m][y] = (float16)(0.0f);
#endif
  }
  const int begin = offsets[tile], end = offsets[tile + 1];
  int2 open = (int2)(0, rows);
  for (int k = begin; k < end; k++) {
    ask_ahead(records, ids, k, end);
    __global const float* s = records + RECORD * (size_t)ids[k];
    const int2 reached = rows_reached(s, left, top, open);
    const float16 dx = s[0] - px, along = s[2] * dx * dx, slope = s[3] * dx;
    for (int y = reached.x; y < reached.y; y++) {
      const float dy = s[1] - ((float)(top + y) + 0.5f);
      const float16 power = fmin(along + (slope * dy + s[4] * dy * dy), (float16)(0.0f)), t = through[y];
      const float16 alpha = fmin(s[5] * exp2_below(power), (float16)(0.99f)), w = t * alpha, next = t - w;
      const int16 seen = alpha >= LEAST_ALPHA, blended = seen & (next >= LEAST_THROUGH);
      const float16 weight = select((float16)(0.0f), w, blended);
      through[y] = select(select(t, -fabs(t), seen), next, blended);
      red[y] += weight * s[6];
      green[y] += weight * s[7];
      blue[y] += weight * s[8];
#if MORE
      UNROLL for (int m = 0; m < MORE; m++) more[m][y] += weight * s[11 + m];
#endif
    }
    if ((k & 15) == 15) {
      open = open_rows(open, through);
      if (open.x == open.y) break;
    }
  }
  for (int y = 0; y < rows; y++) {
    __global float* to = out + (size_t)(top + y) * width + left;
    write_first(red[y], to, width - left);
    write_first(green[y], to + plane, width - left);
    write_first(blue[y], to + 2 * (size_t)plane, width - left);
#if MORE
    UNROLL for (int m = 0; m < MORE; m++) write_first(more[m][y], to + (3 + m) * (size_t)plane, width - left);
#endif
    write_first(fabs(through[y]), to + (3 + MORE) * (size_t)plane, width - left);
  }
}

__kernel FAT void gradient_rows(__global const float* restrict records, __global const int* restrict ids,
                                __global const int* restrict offsets, __global const int* restrict slots,
                                __global const float* restrict out, __global const float* restrict g,
                                __global float* restrict pairs, int height, int width) {
  const int across = (width + TILE - 1) / TILE, tile = get_global_id(0), plane = height * width;
  const int left = tile % across * TILE, top = tile / across * TILE, rows = min(TILE, height - top);
  const float16 px = centres(left);
  float16 through[TILE], behind[TILE], gr[TILE], gg[TILE], gb[TILE];
#if MORE
  float16 gm[MORE][TILE];
#endif
  for (int y = 0; y < TILE; y++) {
    through[y] = (float16)(y < rows ? 1.0f : -1.0f);
    gr[y] = gg[y] = gb[y] = behind[y] = (float16)(0.0f);
#if MORE
    UNROLL for (int m = 0; m < MORE; m++) gm[m][y] = (float16)(0.0f);
#endif
  }
  for (int y = 0; y < rows; y++) {
    const size_t at = (size_t)(top + y) * width + left;
    gr[y] = load_row(g + at, width - left);
    gg[y] = load_row(g + at + plane, width - left);
    gb[y] = load_row(g + at + 2 * (size_t)plane, width - left);
    behind[y] = gr[y] * load_row(out + at, width - left) + gg[y] * load_row(out + at + plane, width - left) +
                gb[y] * load_row(out + at + 2 * (size_t)plane, width - left) +
                load_row(g + at + (3 + MORE) * (size_t)plane, width - left) *
                    load_row(out + at + (3 + MORE) * (size_t)plane, width - left);
#if MORE
    UNROLL for (int m = 0; m < MORE; m++) {
      gm[m][y] = load_row(g + at + (3 + m) * (size_t)plane, width - left);
      behind[y] += gm[m][y] * load_row(out + at + (3 + m) * (size_t)plane, width - left);
    }
#endif
  }
  const int begin = offsets[tile], end = offsets[tile + 1];
  int2 open = (int2)(0, rows);
  for (int k = begin; k < end; k++) {
    ask_ahead(records, ids, k, end);
    __global const float* s = records + RECORD * (size_t)ids[k];
    const int2 reached = rows_reached(s, left, top, open);
    const float16 dx = s[0] - px, along = s[2] * dx * dx, slope = s[3] * dx;
    float16 q0 = (float16)(0.0f), q1 = q0, q2 = q0, red = q0, green = q0, blue = q0;  // sums of q, q dy, q dy^2, w g
    float16 far_x = q0, far_y = q0;                                                    // of |q slope of the power|
#if MORE
    float16 more[MORE];
    UNROLL for (int m = 0; m < MORE; m++) more[m] = q0;
#endif
    for (int y = reached.x; y < reached.y; y++) {
      const float dy = s[1] - ((float)(top + y) + 0.5f);
      const float16 power = fmin(along + (slope * dy + s[4] * dy * dy), (float16)(0.0f)), t = through[y];
      const float16 full = s[5] * exp2_below(power), alpha = fmin(full, (float16)(0.99f)), w = t * alpha, next = t - w;
      const int16 seen = alpha >= LEAST_ALPHA, blended = seen & (next >= LEAST_THROUGH);
      const float16 weight = select((float16)(0.0f), w, blended);
      float16 u = gr[y] * s[6] + gg[y] * s[7] + gb[y] * s[8];
#if MORE
      UNROLL for (int m = 0; m < MORE; m++) {
        u += gm[m][y] * s[11 + m];
        more[m] += weight * gm[m][y];
      }
#endif
      const float16 rest = behind[y] - weight * u;
      const float16 q = select((float16)(0.0f), full * (t * u - rest / (1.0f - alpha)), blended & (full <= 0.99f));
      behind[y] = rest;
      through[y] = select(select(t, -fabs(t), seen), next, blended);
      q0 += q;
      q1 += q * dy;
      q2 += q * (dy * dy);
#if PROBE
      far_x += fabs(q * (2.0f * s[2] * dx + s[3] * dy));
      far_y += fabs(q * (2.0f * s[4] * dy + slope));
#endif
      red += weight * gr[y];
      green += weight * gg[y];
      blue += weight * gb[y];
    }
    const float16 x = q0 * dx, none = (float16)(0.0f), natural = (float16)(1.0f / LOG2_E);
    const float16 by_x = (2.0f * s[2] * x + s[3] * q1) * natural, by_y = (2.0f * s[4] * q1 + s[3] * x) * natural;
    const float16 opacity = q0 * (s[5] > 0.0f ? 1.0f / s[5] : 0.0f);
    const float16 conic = quarters(halves(by_x, by_y), halves(-0.5f * x * dx, -q1 * dx));
    const float16 others = quarters(halves(-0.5f * q2, opacity), halves(none, red));
    const float16 colours = quarters(halves(green, blue), halves(far_x * natural, far_y * natural));
#if MORE
    const float16 last = quarters(halves(more[0], more[1]), none);
#else
    const float16 last = none;
#endif
    store16(lanes(eighths(conic, others), eighths(colours, last)), pairs + PAIR * (size_t)slots[k]);
    if ((k & 15) == 15) open = open_rows(open, through);
  }
}
