// Two pictures x, y of planes [H,W] compared: |x - y| and 1 - SSIM of every value (Wang et al. 2004), and the gradient of
// their weighted sums in x. Means m and variances s (biased) are those of a Gaussian window of 11 x 11 with sigma 1.5; what
// lies outside the picture is zero. Of u = x + y and v = x - y, SSIM's two factors are
//   (2 m_x m_y + C1) / (m_x^2 + m_y^2 + C1) = (m_u^2 - m_v^2 + 2 C1) / (m_u^2 + m_v^2 + 2 C1) = 1 - p,   p = 2 m_v^2 / D1
//   (2 s_xy + C2)    / (s_x + s_y + C2)     = (s_u - s_v + 2 C2)     / (s_u + s_v + 2 C2)     = 1 - q,   q = 2 s_v / D2
// with the denominators D1, D2 to their left: four window means serve (of u, v, u^2, v^2) where x, y, x^2, y^2 and xy are
// five, and 1 - SSIM = p + q - pq of pictures that are alike is no difference of numbers near one. Its derivatives are
//   in m_u^2: -(1-q) p / D1     in m_v^2: (1-q) (2 - p) / D1     in s_u: -(1-p) q / D2     in s_v: (1-p) (2 - q) / D2.
// With s = (mean of squares) - m^2 those in the four means follow; a picture's value has weight w in the means of u and v
// and 2 u w, 2 v w in those of squares around it. So, w being symmetric, the gradient is three means of the same window:
//   mean(slope) + u mean(slope_u) + v mean(slope_v).
// The maps slope, slope_u and slope_v are saved by the comparison when a gradient is wanted. kernels/ssim_cpu.cl is for CPU
// devices.
// version 1. A value a work-item, all 121 places of the window; maps [3][n].
//: variant ssim_values reference any
// On GPUs a group of lanes takes SIDE x SIDE pixels: what their windows see is staged, then means are made along rows, then
// down columns.
//: variant ssim_tiles gpu any LANES=256 SIDE=16
//: variant ssim_tiles gpu any LANES=64 SIDE=16
#define REACH 5
#define C1 0.0001f  // (0.01 L)^2 and (0.03 L)^2 where values go up to L = 1
#define C2 0.0009f
__constant float WINDOW[2 * REACH + 1] = {0.00102838008f, 0.00759875814f, 0.0360007721f, 0.10936069f,
                                          0.213005538f,   0.266011725f,   0.213005538f,  0.10936069f,
                                          0.0360007721f,  0.00759875814f, 0.00102838008f};


// Of value i, 1 - SSIM from the four means; the three slopes if `keep`.
static inline float compare_means(float mean_u, float mean_v, float square_u, float square_v, __global float* maps, int i, int n,
                                  int keep) {
  const float uu = mean_u * mean_u, vv = mean_v * mean_v, variance_u = square_u - uu, variance_v = square_v - vv;
  const float over_d1 = 2.0f / (uu + vv + 2.0f * C1), over_d2 = 2.0f / (variance_u + variance_v + 2.0f * C2);
  const float p = vv * over_d1, q = variance_v * over_d2;
  if (keep) {
    const float of_p = (1.0f - q) * over_d1, of_q = (1.0f - p) * over_d2;
    const float slope_u = -of_q * q, slope_v = of_q * (2.0f - q);
    maps[i] = mean_u * (-of_p * p - slope_u) + mean_v * (of_p * (2.0f - p) - slope_v);
    maps[n + i] = slope_u;
    maps[2 * n + i] = slope_v;
  }
  return p + q - p * q;
}

static inline float sign_of(float v) { return v > 0.0f ? 1.0f : v < 0.0f ? -1.0f : 0.0f; }

// sums [2][n]: |x - y|, 1 - SSIM.
__kernel void ssim_values(__global const float* x, __global const float* y, __global float* sums, __global float* maps,
                          int n, int H, int W, int keep) {
  const int i = get_global_id(0);
  if (i >= n) return;
  const int column = i % W, row = i / W % H;
  float4 means = (float4)(0.0f);  // of u, v, u^2, v^2
  for (int down = max(-REACH, -row); down <= min(REACH, H - 1 - row); down++) {
    float4 line = (float4)(0.0f);  // of its own: fewer roundings a sum
    for (int right = max(-REACH, -column); right <= min(REACH, W - 1 - column); right++) {
      const int at = i + down * W + right;
      const float u = x[at] + y[at], v = x[at] - y[at];
      line += WINDOW[REACH + right] * (float4)(u, v, u * u, v * v);
    }
    means += WINDOW[REACH + down] * line;
  }
  sums[i] = fabs(x[i] - y[i]);
  sums[n + i] = compare_means(means.x, means.y, means.z, means.w, maps, i, n, keep);
}

// weights [2]: of |x - y| and of 1 - SSIM.
__kernel void ssim_values_grad(__global const float* x, __global const float* y, __global const float* maps,
                               __global const float* weights, __global float* dx, int n, int H, int W) {
  const int i = get_global_id(0);
  if (i >= n) return;
  const int column = i % W, row = i / W % H;
  float4 slopes = (float4)(0.0f);
  for (int down = max(-REACH, -row); down <= min(REACH, H - 1 - row); down++) {
    float4 line = (float4)(0.0f);
    for (int right = max(-REACH, -column); right <= min(REACH, W - 1 - column); right++) {
      const int at = i + down * W + right;
      line += WINDOW[REACH + right] * (float4)(maps[at], maps[n + at], maps[2 * n + at], 0.0f);
    }
    slopes += WINDOW[REACH + down] * line;
  }
  const float u = x[i] + y[i], v = x[i] - y[i];
  dx[i] = weights[0] * sign_of(v) + weights[1] * (slopes.x + u * slopes.y + v * slopes.z);
}

#ifdef SIDE
#define PIXELS (SIDE * SIDE)
#define EACH (PIXELS / LANES)  // pixels of a lane
#define SEEN (SIDE + 2 * REACH)  // a side of what the tile's windows see

// The corner of a group's tile and its plane. Groups tile by tile, plane by plane.
static inline int3 tile_at(int group, int H, int W) {
  const int across = (W + SIDE - 1) / SIDE, tiles = across * ((H + SIDE - 1) / SIDE);
  return (int3)(group % across * SIDE, group % tiles / across * SIDE, group / tiles);
}

// Where place e of what is seen lies in the whole of planes, or -1.
static inline int place_of(int e, int3 tile, int H, int W) {
  const int column = tile.x - REACH + e % SEEN, row = tile.y - REACH + e / SEEN;
  return column >= 0 && column < W && row >= 0 && row < H ? (tile.z * H + row) * W + column : -1;
}

// The place of the tile's pixel p in what is seen.
static inline int centre_of(int p) { return (p / SIDE + REACH) * SEEN + p % SIDE + REACH; }

static inline float down(__local const float* lines) {
  float sum = 0.0f;
  UNROLL for (int i = 0; i <= 2 * REACH; i++) sum += WINDOW[i] * lines[i * SIDE];
  return sum;
}

// sums [2][groups].
__kernel __attribute__((reqd_work_group_size(LANES, 1, 1))) void ssim_tiles(__global const float* x, __global const float* y,
                                                                            __global float* sums, __global float* maps,
                                                                            int n, int H, int W, int keep) {
  __local float u[SEEN * SEEN], v[SEEN * SEEN], lines[4][SEEN * SIDE];
  const int lane = get_local_id(0);
  const int3 tile = tile_at(get_group_id(0), H, W);
  for (int e = lane; e < SEEN * SEEN; e += LANES) {
    const int at = place_of(e, tile, H, W);
    u[e] = at < 0 ? 0.0f : x[at] + y[at];
    v[e] = at < 0 ? 0.0f : x[at] - y[at];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int e = lane; e < SEEN * SIDE; e += LANES) {
    const int from = e / SIDE * SEEN + e % SIDE;
    float mean_u = 0.0f, mean_v = 0.0f, square_u = 0.0f, square_v = 0.0f;
    UNROLL for (int i = 0; i <= 2 * REACH; i++) {
      const float a = u[from + i], b = v[from + i];
      mean_u += WINDOW[i] * a;
      mean_v += WINDOW[i] * b;
      square_u += WINDOW[i] * a * a;
      square_v += WINDOW[i] * b * b;
    }
    lines[0][e] = mean_u;
    lines[1][e] = mean_v;
    lines[2][e] = square_u;
    lines[3][e] = square_v;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  float apart[EACH], unlike[EACH];
  UNROLL for (int each = 0; each < EACH; each++) {
    const int p = lane + each * LANES, centre = centre_of(p), i = place_of(centre, tile, H, W);
    apart[each] = fabs(v[centre]);  // outside the picture it is 0
    unlike[each] = 0.0f;
    if (i >= 0)
      unlike[each] = compare_means(down(lines[0] + p), down(lines[1] + p), down(lines[2] + p), down(lines[3] + p), maps, i,
                                   n, keep);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  UNROLL for (int each = 0; each < EACH; each++) {
    u[lane + each * LANES] = apart[each];
    v[lane + each * LANES] = unlike[each];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int left = PIXELS / 2; left > 0; left /= 2) {
    for (int p = lane; p < left; p += LANES) {
      u[p] += u[p + left];
      v[p] += v[p + left];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  if (lane == 0) {
    sums[get_group_id(0)] = u[0];
    sums[get_num_groups(0) + get_group_id(0)] = v[0];
  }
}

__kernel __attribute__((reqd_work_group_size(LANES, 1, 1))) void ssim_tiles_grad(
    __global const float* x, __global const float* y, __global const float* maps, __global const float* weights,
    __global float* dx, int n, int H, int W) {
  __local float seen[3][SEEN * SEEN], lines[3][SEEN * SIDE];
  const int lane = get_local_id(0);
  const int3 tile = tile_at(get_group_id(0), H, W);
  for (int e = lane; e < SEEN * SEEN; e += LANES) {
    const int at = place_of(e, tile, H, W);
    for (int map = 0; map < 3; map++) seen[map][e] = at < 0 ? 0.0f : maps[map * n + at];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int e = lane; e < SEEN * SIDE; e += LANES) {
    const int from = e / SIDE * SEEN + e % SIDE;
    for (int map = 0; map < 3; map++) {
      float sum = 0.0f;
      UNROLL for (int i = 0; i <= 2 * REACH; i++) sum += WINDOW[i] * seen[map][from + i];
      lines[map][e] = sum;
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int p = lane; p < PIXELS; p += LANES) {
    const int i = place_of(centre_of(p), tile, H, W);
    if (i >= 0) {
      const float a = x[i] + y[i], b = x[i] - y[i];
      const float slope = down(lines[0] + p) + a * down(lines[1] + p) + b * down(lines[2] + p);
      dx[i] = weights[0] * sign_of(b) + weights[1] * slope;
    }
  }
}
#endif
