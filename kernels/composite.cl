// Light along rays, front to back (Max 1995; NeRF eq. 3): w_i = alpha_i prod_{j<i} (1 - alpha_j). Ragged: ray r owns the
// places [offsets[r], offsets[r + 1]). matter is opacity alpha or, with DENSITY, sigma: alpha = 1 - exp(-sigma dt). With
// ROWS place i is row rows[i] of matter, dt and features, else row i. sky: the last sample takes the light that is left.
// Every kernel: version 1, a work-item a ray (a chunk of rays on CPU devices). WIDTH: 4, 8, 16,
// 32 or 64 registers for the sums of up to so many channels (WHOLE: of just as many), 0: of more channels, none.
//: variant composite reference any
//: variant composite gpu any
#define EACH_CHANNEL for (int c = 0; c < (WIDTH ? WIDTH : channels); c++) if (WHOLE || c < channels)
#define EXTRA (3 + 2 * SIGHT)

static inline int row_of(__global const int* rows, int i) { return ROWS ? rows[i] : i; }
static inline float alpha_at(__global const float* matter, __global const float* dt, int row) {
  return DENSITY ? 1.0f - m_exp(-matter[row] * dt[row]) : matter[row];
}

// Distance as seen by the distortion loss: near and far alike fill [0,1).
static inline float squashed(float t) { return t / (1.0f + t); }
static inline float squashed_length(float t, float dt) { return squashed(t + 0.5f * dt) - squashed(t - 0.5f * dt); }

// Further than `near` from where the LiDAR saw something; range 0: it did not look.
static inline int strays(float distance, float range, float near) { return range > 0.0f && fabs(distance - range) > near; }

// out [R, channels + EXTRA + DENSITY]: sum of w f; opacity (1 - the light that is left; with a sky the sum of w where
// t >= 0); depth, the sum of w |t|; distortion (mip-NeRF 360 eq. 15: sum w_i w_j |s_i - s_j| + 1/3 sum w_i^2 ds_i, here
// with sums over what lies in front, since s ascends); with SIGHT the sum of w^2 of what strays, and the sum of w of rows
// from `split` on; with DENSITY the sum of w s for the adjoint.
FAT __kernel void composite(__global const float* restrict matter, __global const float* restrict dt, __global const int* restrict rows,
                            __global const float* restrict features, __global const float* restrict t, __global const int* restrict offsets,
                            __global const float* restrict ranges, __global float* restrict out, int rays, int channels, int sky, int split,
                            float near, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    __global float* to = out + (size_t)r * (channels + EXTRA + DENSITY);
#if WIDTH
    float sum[WIDTH];
#else
    __global float* sum = to;
#endif
    EACH_CHANNEL sum[c] = 0.0f;
    float through = 1.0f, opacity = 0.0f, depth = 0.0f, distortion = 0.0f, stray = 0.0f, marked = 0.0f, front = 0.0f, front_s = 0.0f;
    const int last = offsets[r + 1];
    for (int i = offsets[r]; i < last; i++) {
      const int row = row_of(rows, i);
      const float alpha = alpha_at(matter, dt, row), w = through * (sky && i + 1 == last ? 1.0f : alpha), distance = fabs(t[i]);
      __global const float* f = features + (size_t)row * channels;
      EACH_CHANNEL sum[c] += w * f[c];
      depth += w * distance;
      if (t[i] >= 0.0f) opacity += w;
      if (SIGHT && strays(distance, ranges[r], near)) stray += w * w;
      if (SIGHT && row >= split) marked += w;
      if (DENSITY) {
        const float s = squashed(distance);
        distortion += w * (2.0f * (s * front - front_s) + w * squashed_length(distance, dt[row]) * (1.0f / 3.0f));
        front += w;
        front_s += w * s;
      }
      through *= 1.0f - alpha;
    }
#if WIDTH
    EACH_CHANNEL to[c] = sum[c];
#endif
    to[channels] = sky ? opacity : 1.0f - through;
    to[channels + 1] = depth;
    to[channels + 2] = distortion;
    if (SIGHT) to[channels + 3] = stray;
    if (SIGHT) to[channels + 4] = marked;
    if (DENSITY) to[channels + EXTRA] = front_s;
  }
}

FAT __kernel void composite_weights(__global const float* restrict matter, __global const float* restrict dt, __global const int* restrict rows,
                                    __global const int* restrict offsets, __global float* restrict weights, int rays, int sky, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    float through = 1.0f;
    const int last = offsets[r + 1];
    for (int i = offsets[r]; i < last; i++) {
      const float alpha = alpha_at(matter, dt, row_of(rows, i));
      weights[i] = through * (sky && i + 1 == last ? 1.0f : alpha);
      through *= 1.0f - alpha;
    }
  }
}

// Adjoints: with u_i the derivative by w_i and T_i the light that reaches a sample,
//   d alpha_i = T_i u_i - sum_{j>i} w_j u_j / (1 - alpha_i),  d sigma_i = dt_i (T_{i+1} u_i - sum_{j>i} w_j u_j).
// From the back, where that sum holds only what light reaches, so that samples which nothing is seen of get next to
// nothing in spite of the division. T_i lies in the place of the result.
INLINE void lay_light(__global const float* matter, __global const float* dt, __global const int* rows, int first, int last, __global float* dmatter) {
  float through = 1.0f;
  for (int i = first; i < last; i++) {
    const int row = row_of(rows, i);
    dmatter[row] = through;
    through *= 1.0f - alpha_at(matter, dt, row);
  }
}
static inline float from_behind(float alpha, float light, float u, float behind, float length) {
  return DENSITY ? length * (light * (1.0f - alpha) * u - behind) : light * u - behind / fmax(1.0f - alpha, 1e-6f);
}

FAT __kernel void composite_weights_grad(__global const float* restrict matter, __global const float* restrict dt, __global const int* restrict rows,
                                         __global const int* restrict offsets, __global const float* restrict g, __global float* restrict dmatter,
                                         int rays, int sky, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const int first = offsets[r], last = offsets[r + 1];
    lay_light(matter, dt, rows, first, last, dmatter);
    float behind = 0.0f;
    for (int i = last - 1; i >= first; i--) {
      const int row = row_of(rows, i), takes_rest = sky && i + 1 == last;
      const float alpha = takes_rest ? 1.0f : alpha_at(matter, dt, row), light = dmatter[row];
      dmatter[row] = takes_rest ? 0.0f : from_behind(alpha, light, g[i], behind, DENSITY ? dt[row] : 0.0f);
      behind += light * alpha * g[i];
    }
  }
}

typedef struct {
  int row;
  float w, t, range;
} Place;

// The derivative by the weight of a place, but for the distortion's; its features' gradient is written.
INLINE float take_gradient(const Place* at, __global const float* features, __global const float* g, __global float* dfeatures, int channels,
                           int split, float near) {
  __global const float* f = features + (size_t)at->row * channels;
  __global float* df = dfeatures + (size_t)at->row * channels;
  float u = fabs(at->t) * g[channels + 1];
  EACH_CHANNEL u += f[c] * g[c];
  EACH_CHANNEL df[c] = at->w * g[c];
  if (at->t >= 0.0f) u += g[channels];
  if (SIGHT && strays(fabs(at->t), at->range, near)) u += 2.0f * at->w * g[channels + 3];
  if (SIGHT && at->row >= split) u += g[channels + 4];
  return u;
}

// dmatter [rows], and behind it df [rows, channels]. Densities go in one sweep from the front, since out holds the sums over
// the whole ray: sum_{j>i} w_j u_j = sum w u - sum up to i; the distortion and what strays are of degree 2 in w.
// d distortion / d w_i = 2 sum_j w_j |s_i - s_j| + 2/3 w_i ds_i.
FAT __kernel void composite_grad(__global const float* restrict matter, __global const float* restrict dt, __global const int* restrict rows,
                                 __global const float* restrict features, __global const float* restrict t, __global const int* restrict offsets,
                                 __global const float* restrict ranges, __global const float* restrict out, __global const float* restrict g,
                                 __global float* restrict dmatter, int rays, int samples, int channels, int sky, int split, float near, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk), width = channels + EXTRA + DENSITY;
  __global float* dfeatures = dmatter + samples;
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    __global const float* gr = g + (size_t)r * width;
    const int first = offsets[r], last = offsets[r + 1];
    const float range = SIGHT ? ranges[r] : 0.0f;
#if DENSITY
    __global const float* sums = out + (size_t)r * width;
    const float all = sky ? 1.0f : sums[channels], all_s = sums[channels + EXTRA];
    float rest = gr[channels + 2] * sums[channels + 2] + (SIGHT ? gr[channels + 3] * sums[channels + 3] : 0.0f);
    for (int c = 0; c < channels + EXTRA; c++) rest += gr[c] * sums[c];
    float through = 1.0f, front = 0.0f, front_s = 0.0f;
    for (int i = first; i < last; i++) {
      const int row = row_of(rows, i), takes_rest = sky && i + 1 == last;
      const float alpha = takes_rest ? 1.0f : alpha_at(matter, dt, row), s = squashed(fabs(t[i]));
      const Place at = {row, through * alpha, t[i], range};
      const float behind = all - front - at.w, behind_s = all_s - front_s - at.w * s;
      const float spread = 2.0f * (s * front - front_s + behind_s - s * behind) + at.w * squashed_length(fabs(t[i]), dt[row]) * (2.0f / 3.0f);
      const float u = take_gradient(&at, features, gr, dfeatures, channels, split, near) + gr[channels + 2] * spread;
      through *= 1.0f - alpha;
      front += at.w;
      front_s += at.w * s;
      rest -= at.w * u;
      dmatter[row] = takes_rest ? 0.0f : dt[row] * (through * u - rest);
    }
#else
    lay_light(matter, dt, rows, first, last, dmatter);
    float behind = 0.0f;
    for (int i = last - 1; i >= first; i--) {
      const int row = row_of(rows, i), takes_rest = sky && i + 1 == last;
      const float alpha = takes_rest ? 1.0f : matter[row], light = dmatter[row];
      const Place at = {row, light * alpha, t[i], range};
      const float u = take_gradient(&at, features, gr, dfeatures, channels, split, near);
      dmatter[row] = takes_rest ? 0.0f : from_behind(alpha, light, u, behind, 0.0f);
      behind += at.w * u;
    }
#endif
  }
}
