// Zip-NeRF's downweighting (Barron et al. 2023, section 2): features [n * places, LEVELS * FEATURES] of the places that a
// sample is read at -> their weighted mean [n, LEVELS * FEATURES]. A place of width s, in the unit of the grid, has the
// weight erf(1 / sqrt(8 (s cells)^2)) in a level of so many cells an axis: near 1 where cells are wider than the place.
// downweighted_mean, version 1: a work-item a sample and level.
// downweighted_blocks, for CPU devices: the weights of TILE places are computed as vectors, for BLOCK samples whose features
// stay in the cache while levels are gone through.
//: variant downweighted_mean reference any
//: variant downweighted_mean gpu any
//: variant downweighted_blocks cpu any BLOCK=16 TILE=32
#if FEATURES == 4
typedef float4 feature;
#define LOAD(i, p) vload4(i, p)
#define STORE(v, i, p) vstore4(v, i, p)
#elif FEATURES == 2
typedef float2 feature;
#define LOAD(i, p) vload2(i, p)
#define STORE(v, i, p) vstore2(v, i, p)
#else
typedef float feature;
#define LOAD(i, p) (p)[i]
#define STORE(v, i, p) (p)[i] = (v)
#endif

// erf of x > 0 by Abramowitz and Stegun, 7.1.26, |error| < 2e-7: half of m_erf's operations, which is precise near 0, too.
INLINE float weight_of(float width, float cells) {
  const float x = 0.35355339059f / fmax(width * cells, 1e-9f), t = 1.0f / (1.0f + 0.3275911f * x);
  float p = 1.061405429f;
  p = p * t - 1.453152027f;
  p = p * t + 1.421413741f;
  p = p * t - 0.284496736f;
  p = p * t + 0.254829592f;
  return 1.0f - p * t * m_exp(-x * x);
}

__kernel void downweighted_mean(__global const float* restrict features, __global const float* restrict widths, __global const float* restrict cells,
                                __global float* restrict out, int n, int places, int level_count) {
  const int item = get_global_id(0);
  if (item >= n * level_count) return;
  const int s = item / level_count, level = item % level_count;
  feature total = (feature)(0.0f);
  for (int p = s * places; p < (s + 1) * places; p++) total += weight_of(widths[p], cells[level]) * LOAD((size_t)p * level_count + level, features);
  STORE(total / (float)places, item, out);
}

// g [n, LEVELS * FEATURES] -> as the features; a work-item a place and level.
__kernel void downweighted_mean_grad(__global const float* restrict widths, __global const float* restrict cells, __global const float* restrict g,
                                     __global float* restrict out, int n, int places, int level_count) {
  const int item = get_global_id(0);
  if (item >= n * places * level_count) return;
  const int p = item / level_count, level = item % level_count;
  STORE(weight_of(widths[p], cells[level]) / (float)places * LOAD((size_t)(p / places) * level_count + level, g), item, out);
}

#ifdef BLOCK
// Weights of the places [first, first + count) in one level; a whole tile by a loop whose length the compiler knows.
INLINE void find_weights(__global const float* restrict widths, float cells, int first, int count, float* weights) {
  if (count == TILE)
    for (int i = 0; i < TILE; i++) weights[i] = weight_of(widths[first + i], cells);
  else
    for (int i = 0; i < count; i++) weights[i] = weight_of(widths[first + i], cells);
}

FAT __kernel void downweighted_blocks(__global const float* restrict features, __global const float* restrict widths, __global const float* restrict cells,
                                      __global float* restrict out, int n, int places, int level_count, int chunk) {
  const int end = LOOP_HI(n, chunk);
  const float part = 1.0f / (float)places;
  for (int first = LOOP_LO(chunk); first < end; first += BLOCK)
    for (int level = 0; level < level_count; level++) {
      const int last = min(end, first + BLOCK) * places;
      int s = first, place = 0;
      feature total = (feature)(0.0f);
      for (int tile = first * places; tile < last; tile += TILE) {
        float weights[TILE];
        const int count = min(TILE, last - tile);
        find_weights(widths, cells[level], tile, count, weights);
        for (int i = 0; i < count;) {
          const int run = min(count - i, places - place);
          for (int k = i; k < i + run; k++) total += weights[k] * LOAD((size_t)(tile + k) * level_count + level, features);
          i += run;
          place += run;
          if (place < places) break;
          STORE(total * part, (size_t)s * level_count + level, out);
          total = (feature)(0.0f);
          place = 0;
          s++;
        }
      }
    }
}

FAT __kernel void downweighted_blocks_grad(__global const float* restrict widths, __global const float* restrict cells, __global const float* restrict g,
                                           __global float* restrict out, int n, int places, int level_count, int chunk) {
  const int end = LOOP_HI(n, chunk);
  const float part = 1.0f / (float)places;
  for (int first = LOOP_LO(chunk); first < end; first += BLOCK)
    for (int level = 0; level < level_count; level++) {
      const int last = min(end, first + BLOCK) * places;
      int s = first, place = 0;
      for (int tile = first * places; tile < last; tile += TILE) {
        float weights[TILE];
        const int count = min(TILE, last - tile);
        find_weights(widths, cells[level], tile, count, weights);
        for (int i = 0; i < count;) {
          const int run = min(count - i, places - place);
          const feature of_each = part * LOAD((size_t)s * level_count + level, g);
          for (int k = i; k < i + run; k++) STORE(weights[k] * of_each, (size_t)(tile + k) * level_count + level, out);
          i += run;
          place += run;
          if (place < places) break;
          place = 0;
          s++;
        }
      }
    }
}
#endif
