// Front-to-back blending of 2D Gaussians (Kerbl et al. 2023, 3D Gaussian Splatting, section 4). A tile is 16 x 16
// pixels; tile t blends the gaussians ids[offsets[t]] ... ids[offsets[t + 1] - 1] in this order. At a pixel's centre
//   power = -1/2 (a dx^2 + c dy^2) - b dx dy,   alpha = min(0.99, opacity exp(power)),   w = T alpha,   T' = T (1 - alpha);
// passed over where alpha < 1/255 (power, which rounding may bring above 0, counts as 0 there); the pixel is done before T' would fall below 1e-4.
// out [4,H,W]: red, green, blue, T; with MORE = 2 further channels [6,H,W], T last. splats [G,7]: mean x, y in pixels, a, b, c
// of the inverse covariance, opacity, depth (which is not read).
//
// The gradient: with u_i = g . colour_i and B_i what is blended behind i (all of g . out less what lies up to i),
// d loss / d alpha_i = T_i u_i - B_i / (1 - alpha_i). It goes to [P,16], a row a pair of tile and gaussian: the splat's 7,
// colour 3, the sums over pixels of |d loss / d x| and |d loss / d y| (Ye et al. 2024, AbsGS), further channels, zeros. Pair k fills
// row slots[k], such that rows of one gaussian are neighbours; they are summed afterwards, in a fixed order.
//: variant blend_pixels reference forward
//: variant gradient_tiles reference gradient
//: variant blend_groups gpu forward LANES=256
//: variant blend_groups gpu forward LANES=64
//: variant gradient_groups gpu gradient LANES=256
//: variant gradient_groups gpu gradient LANES=64
#define TILE 16
#define PAIR 16
#define LEAST_ALPHA (1.0f / 255.0f)
#define LEAST_THROUGH 1e-4f
#ifndef MORE
#define MORE 0
#endif
#define CHANNELS (3 + MORE)

typedef struct {
  float x, y, a, b, c, opacity, colour[CHANNELS];
} Splat;

static inline Splat splat_of(int id, __global const float* splats, __global const float* colours) {
  __global const float *s = splats + 7 * (size_t)id, *c = colours + CHANNELS * (size_t)id;
  Splat out = {s[0], s[1], s[2], s[3], s[4], s[5], {c[0], c[1], c[2]}};
  UNROLL for (int channel = 3; channel < CHANNELS; channel++) out.colour[channel] = c[channel];
  return out;
}

// exp(power) at a pixel, 0 where the gaussian is passed over.
static inline float falloff(Splat s, float dx, float dy) {
  const float e = m_exp(fmin(-0.5f * (s.a * dx * dx + s.c * dy * dy) - s.b * dx * dy, 0.0f));
  return fmin(0.99f, s.opacity * e) < LEAST_ALPHA ? 0.0f : e;
}

// What a pixel has seen so far.
typedef struct {
  float through, colour[CHANNELS];
  int done;
} Pixel;

static inline Pixel fresh_pixel() {
  Pixel out;
  out.through = 1.0f;
  out.done = 0;
  UNROLL for (int channel = 0; channel < CHANNELS; channel++) out.colour[channel] = 0.0f;
  return out;
}

static inline void blend(Pixel* p, Splat s, int x, int y) {
  const float alpha = fmin(0.99f, s.opacity * falloff(s, s.x - ((float)x + 0.5f), s.y - ((float)y + 0.5f)));
  const float next = p->through * (1.0f - alpha), w = p->through * alpha;
  p->done = next < LEAST_THROUGH;
  if (!p->done) {
    UNROLL for (int channel = 0; channel < CHANNELS; channel++) p->colour[channel] += w * s.colour[channel];
    p->through = next;
  }
}

static inline void store_pixel(Pixel p, __global float* out, int i, int plane) {
  UNROLL for (int channel = 0; channel < CHANNELS; channel++) out[channel * plane + i] = p.colour[channel];
  out[CHANNELS * plane + i] = p.through;
}

// g . out at a pixel.
static inline float all_of(__global const float* g, __global const float* out, int i, int plane) {
  float sum = 0.0f;
  UNROLL for (int channel = 0; channel <= CHANNELS; channel++) sum += g[channel * plane + i] * out[channel * plane + i];
  return sum;
}

// Where the gradient of a channel goes in a pair's row.
static inline int column_of(int channel) { return channel < 3 ? 7 + channel : 9 + channel; }

// version 1: a work-item a pixel.
__kernel void blend_pixels(__global const float* restrict splats, __global const float* restrict colours, __global const int* restrict ids, __global const int* restrict offsets,
                           __global float* restrict out, int height, int width) {
  const int i = get_global_id(0), x = i % width, y = i / width, plane = height * width;
  if (i >= plane) return;
  const int tile = y / TILE * ((width + TILE - 1) / TILE) + x / TILE, end = offsets[tile + 1];
  Pixel pixel = fresh_pixel();
  for (int k = offsets[tile]; k < end && !pixel.done; k++) blend(&pixel, splat_of(ids[k], splats, colours), x, y);
  store_pixel(pixel, out, i, plane);
}

// version 1: a work-item a tile; a pixel at a time adds its part to the rows of the tile's pairs.
__kernel void gradient_tiles(__global const float* restrict splats, __global const float* restrict colours, __global const int* restrict ids, __global const int* restrict offsets,
                             __global const int* restrict slots, __global const float* restrict out,
                             __global const float* restrict g, __global float* restrict pairs, int height, int width) {
  const int across = (width + TILE - 1) / TILE, tile = get_global_id(0), plane = height * width;
  if (tile >= across * ((height + TILE - 1) / TILE)) return;
  const int begin = offsets[tile], end = offsets[tile + 1];
  for (int k = begin; k < end; k++)
    for (int v = 0; v < PAIR; v++) pairs[PAIR * (size_t)slots[k] + v] = 0.0f;
  for (int p = 0; p < TILE * TILE; p++) {
    const int x = tile % across * TILE + p % TILE, y = tile / across * TILE + p / TILE, i = y * width + x;
    if (x >= width || y >= height) continue;
    float through = 1.0f, behind = all_of(g, out, i, plane);
    int done = 0;
    for (int k = begin; k < end && !done; k++) {
      const Splat s = splat_of(ids[k], splats, colours);
      const float dx = s.x - ((float)x + 0.5f), dy = s.y - ((float)y + 0.5f), full = s.opacity * falloff(s, dx, dy);
      const float alpha = fmin(0.99f, full), next = through * (1.0f - alpha), w = through * alpha;
      done = next < LEAST_THROUGH;
      if (alpha > 0.0f && !done) {
        float u = 0.0f;
        UNROLL for (int channel = 0; channel < CHANNELS; channel++) u += g[channel * plane + i] * s.colour[channel];
        behind -= w * u;
        const float d_power = full > 0.99f ? 0.0f : full * (through * u - behind / (1.0f - alpha));
        const float by_x = d_power * (s.a * dx + s.b * dy), by_y = d_power * (s.c * dy + s.b * dx);
        __global float* to = pairs + PAIR * (size_t)slots[k];
        to[0] -= by_x;
        to[1] -= by_y;
        to[2] -= d_power * 0.5f * dx * dx;
        to[3] -= d_power * dx * dy;
        to[4] -= d_power * 0.5f * dy * dy;
        to[5] += d_power / s.opacity;  // blended: above 0
        UNROLL for (int channel = 0; channel < CHANNELS; channel++) to[column_of(channel)] += w * g[channel * plane + i];
        to[10] += fabs(by_x);
        to[11] += fabs(by_y);
        through = next;
      }
    }
  }
}

// GPU devices: a group a tile, a lane every LANES-th pixel; gaussians come in batches through local memory.
#ifdef LANES
#define PIXELS (TILE * TILE)
#define EACH (PIXELS / LANES)  // pixels of a lane

__kernel __attribute__((reqd_work_group_size(LANES, 1, 1))) void blend_groups(
    __global const float* restrict splats, __global const float* restrict colours, __global const int* restrict ids, __global const int* restrict offsets,
    __global float* restrict out, int height, int width) {
  __local Splat batch[LANES];
  const int across = (width + TILE - 1) / TILE, tile = get_group_id(0), lane = get_local_id(0), plane = height * width;
  const int left = tile % across * TILE, top = tile / across * TILE, end = offsets[tile + 1];
  Pixel pixels[EACH];
  UNROLL for (int each = 0; each < EACH; each++) pixels[each] = fresh_pixel();
  for (int from = offsets[tile]; from < end; from += LANES) {
    if (from + lane < end) batch[lane] = splat_of(ids[from + lane], splats, colours);
    barrier(CLK_LOCAL_MEM_FENCE);
    const int count = min(LANES, end - from);
    UNROLL for (int each = 0; each < EACH; each++) {
      const int p = lane + each * LANES, x = left + p % TILE, y = top + p / TILE;
      for (int k = 0; k < count && !pixels[each].done; k++) blend(&pixels[each], batch[k], x, y);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  UNROLL for (int each = 0; each < EACH; each++) {
    const int p = lane + each * LANES, x = left + p % TILE, y = top + p / TILE;
    if (x < width && y < height) store_pixel(pixels[each], out, y * width + x, plane);
  }
}

// The lanes find d loss / d power and w of FEW gaussians at their pixels; then, turned round, PARTS sums a gaussian go over
// FEW pixels each, and a lane a number joins the parts.
#define FEW (MORE ? 4 : 8)  // what local memory holds
#define PARTS (PIXELS / FEW)
#define NUMBERS (12 + MORE)  // of PAIR

__kernel __attribute__((reqd_work_group_size(LANES, 1, 1))) void gradient_groups(
    __global const float* restrict splats, __global const float* restrict colours, __global const int* restrict ids, __global const int* restrict offsets,
    __global const int* restrict slots, __global const float* restrict out, __global const float* restrict g,
    __global float* restrict pairs, int height, int width) {
  __local Splat batch[FEW];
  __local float d_power[FEW][PIXELS], weight[FEW][PIXELS], g_colour[CHANNELS][PIXELS], parts[NUMBERS][PIXELS];
  const int across = (width + TILE - 1) / TILE, tile = get_group_id(0), lane = get_local_id(0), plane = height * width;
  const int left = tile % across * TILE, top = tile / across * TILE, end = offsets[tile + 1];
  float through[EACH], behind[EACH];
  int done[EACH];
  UNROLL for (int each = 0; each < EACH; each++) {
    const int p = lane + each * LANES, x = left + p % TILE, y = top + p / TILE;
    const int inside = x < width && y < height, i = inside ? y * width + x : 0;
    through[each] = 1.0f;
    behind[each] = inside ? all_of(g, out, i, plane) : 0.0f;
    done[each] = 0;
    UNROLL for (int channel = 0; channel < CHANNELS; channel++) g_colour[channel][p] = inside ? g[channel * plane + i] : 0.0f;
  }
  for (int from = offsets[tile]; from < end; from += FEW) {
    const int count = min(FEW, end - from);
    if (lane < count) batch[lane] = splat_of(ids[from + lane], splats, colours);
    barrier(CLK_LOCAL_MEM_FENCE);
    UNROLL for (int each = 0; each < EACH; each++) {
      const int p = lane + each * LANES, x = left + p % TILE, y = top + p / TILE;
      float gradient[CHANNELS];
      UNROLL for (int channel = 0; channel < CHANNELS; channel++) gradient[channel] = g_colour[channel][p];
      for (int k = 0; k < count; k++) {
        const Splat s = batch[k];
        const float full = s.opacity * falloff(s, s.x - ((float)x + 0.5f), s.y - ((float)y + 0.5f));
        const float alpha = fmin(0.99f, full), next = through[each] * (1.0f - alpha);
        done[each] |= next < LEAST_THROUGH;
        const float w = done[each] ? 0.0f : through[each] * alpha;
        float u = 0.0f;
        UNROLL for (int channel = 0; channel < CHANNELS; channel++) u += gradient[channel] * s.colour[channel];
        behind[each] -= w * u;
        d_power[k][p] =
            done[each] || full > 0.99f ? 0.0f : full * (through[each] * u - behind[each] / (1.0f - alpha));
        weight[k][p] = w;
        through[each] = done[each] ? through[each] : next;
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int e = lane; e < PIXELS; e += LANES) {
      const int mine = e / PARTS;
      float sums[NUMBERS];
      UNROLL for (int v = 0; v < NUMBERS; v++) sums[v] = 0.0f;
      if (mine < count) {
        const Splat s = batch[mine];
        for (int p = e % PARTS; p < PIXELS; p += PARTS) {
          const float q = d_power[mine][p], w = weight[mine][p];
          const float dx = s.x - ((float)(left + p % TILE) + 0.5f), dy = s.y - ((float)(top + p / TILE) + 0.5f);
          const float by_x = q * (s.a * dx + s.b * dy), by_y = q * (s.c * dy + s.b * dx);
          sums[0] -= by_x;
          sums[1] -= by_y;
          sums[2] -= q * 0.5f * dx * dx;
          sums[3] -= q * dx * dy;
          sums[4] -= q * 0.5f * dy * dy;
          sums[5] += q;
          UNROLL for (int channel = 0; channel < CHANNELS; channel++) sums[column_of(channel)] += w * g_colour[channel][p];
          sums[10] += fabs(by_x);
          sums[11] += fabs(by_y);
        }
      }
      UNROLL for (int v = 0; v < NUMBERS; v++) parts[v][e] = sums[v];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int e = lane; e < (PAIR - NUMBERS) * count; e += LANES)
      pairs[PAIR * (size_t)slots[from + e / (PAIR - NUMBERS)] + NUMBERS + e % (PAIR - NUMBERS)] = 0.0f;
    for (int e = lane; e < NUMBERS * count; e += LANES) {
      const int which = e / NUMBERS, number = e % NUMBERS;
      float total = 0.0f;
      for (int p = 0; p < PARTS; p++) total += parts[number][which * PARTS + p];
      const float opacity = batch[which].opacity;
      if (number == 5) total = opacity > 0.0f ? total / opacity : 0.0f;
      pairs[PAIR * (size_t)slots[from + which] + number] = total;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
#endif
