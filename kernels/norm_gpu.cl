// Normalisations and softmax where a work-item is a lane: a group of LANES takes a row (or a group of channels), lanes
// side by side, and sums by a tree in local memory. Arguments as in norm_cpu.cl.
//: variant group_norm gpu group_norm LANES=128 PARTS=1
//: variant group_norm gpu group_norm LANES=64 PARTS=2
//: variant group_norm_grad gpu group_norm_grad LANES=128 PARTS=1
//: variant group_norm_grad gpu group_norm_grad LANES=64 PARTS=2
//: variant layer_norm gpu layer_norm LANES=64
//: variant layer_norm_grad gpu layer_norm_grad LANES=64
//: variant softmax gpu softmax LANES=64
//: variant softmax_grad gpu softmax_grad LANES=64
#ifndef PARTS
#define PARTS 1  // of a lane's sum, as so many lanes would have it: the tree's first steps, which it takes alone
#endif
#define ROWS __attribute__((reqd_work_group_size(LANES, 1, 1)))
#define ROW_LO(chunk) ((int)get_group_id(0) * (chunk))
#define ROW_HI(n, chunk) min((n), ((int)get_group_id(0) + 1) * (chunk))

#define ADD(a, b) ((a) + (b))
#define OVER_LANES(name, join)                                                               \
  static inline float name(float value, __local float* shared) {                             \
    const int lane = get_local_id(0);                                                        \
    barrier(CLK_LOCAL_MEM_FENCE); /* what was here before is read */                         \
    shared[lane] = value;                                                                    \
    for (int width = LANES / 2; width > 0; width /= 2) {                                     \
      barrier(CLK_LOCAL_MEM_FENCE);                                                          \
      if (lane < width) shared[lane] = join(shared[lane], shared[lane + width]);             \
    }                                                                                        \
    barrier(CLK_LOCAL_MEM_FENCE);                                                            \
    return shared[0];                                                                        \
  }
OVER_LANES(sum_lanes, ADD)
OVER_LANES(max_lanes, fmax)

static inline float2 moments(__global const float* restrict x, int n, __local float* shared) {
  const float centre = x[0];
  float sum = 0.0f, squares = 0.0f;
  for (int part = 0; part < PARTS; part++) {
    float part_sum = 0.0f, part_squares = 0.0f;
    for (int i = get_local_id(0) + part * LANES; i < n; i += PARTS * LANES) {
      const float d = x[i] - centre;
      part_sum += d;
      part_squares += d * d;
    }
    sum += part_sum;
    squares += part_squares;
  }
  const float mean = sum_lanes(sum, shared) / n;
  return (float2)(centre + mean, fmax(sum_lanes(squares, shared) / n - mean * mean, 0.0f));
}

static inline float activation(float t) { return SILU ? t * m_sigmoid(t) : t; }
static inline float activation_slope(float t) {
  if (!SILU) return 1.0f;
  const float s = m_sigmoid(t);
  return s * (1.0f + t * (1.0f - s));
}

ROWS __kernel void group_norm(__global const float* restrict x, __global const float* restrict a,
                              __global const float* restrict b, __global float* restrict y,
                              __global float* restrict stats, int rows, int groups, int channels, int pixels,
                              int image_pitch, float epsilon, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0);
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * channels * pixels;
    const float2 moment = moments(x + begin, channels * pixels, shared);
    const float mean = moment.x, rate = 1.0f / sqrt(moment.y + epsilon);
    if (lane == 0) stats[2 * row] = mean, stats[2 * row + 1] = rate;
    const int image = row / groups, first = image * image_pitch + (row - image * groups) * channels;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c] * rate, shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      for (int i = lane; i < pixels; i += LANES) y[channel + i] = activation((x[channel + i] - mean) * scale + shift);
    }
  }
}

ROWS __kernel void group_norm_grad(__global const float* restrict x, __global const float* restrict a,
                                   __global const float* restrict b, __global const float* restrict stats,
                                   __global const float* restrict dy, __global float* restrict out, int rows, int groups,
                                   int channels, int pixels, int image_pitch, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0);
  __global float* da = out + (size_t)rows * channels * pixels;
  __global float* db = da + rows * channels;
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * channels * pixels;
    const float mean = stats[2 * row], rate = stats[2 * row + 1];
    const int image = row / groups, first = image * image_pitch + (row - image * groups) * channels;
    float sum = 0.0f, sum_u = 0.0f;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c], shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      float total = 0.0f, total_u = 0.0f;
      for (int part = 0; part < PARTS; part++) {
        float part_total = 0.0f, part_u = 0.0f;
        for (int i = lane + part * LANES; i < pixels; i += PARTS * LANES) {
          const float u = (x[channel + i] - mean) * rate;
          const float d = dy[channel + i] * activation_slope(u * scale + shift);
          part_total += d;
          part_u += d * u;
        }
        total += part_total;
        total_u += part_u;
      }
      total = sum_lanes(total, shared);
      total_u = sum_lanes(total_u, shared);
      if (lane == 0) da[row * channels + c] = total_u, db[row * channels + c] = total;
      sum += scale * total;
      sum_u += scale * total_u;
    }
    const float n = channels * pixels, every = sum / n, slope = sum_u / n;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c], shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      for (int i = lane; i < pixels; i += LANES) {
        const float u = (x[channel + i] - mean) * rate;
        const float d = dy[channel + i] * activation_slope(u * scale + shift);
        out[channel + i] = (d * scale - every - u * slope) * rate;
      }
    }
  }
}

ROWS __kernel void layer_norm(__global const float* restrict x, __global const float* restrict gamma,
                              __global const float* restrict beta, __global float* restrict y,
                              __global float* restrict stats, int rows, int n, float epsilon, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0);
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    const float2 moment = moments(x + begin, n, shared);
    const float mean = moment.x, rate = 1.0f / sqrt(moment.y + epsilon);
    if (lane == 0) stats[2 * row] = mean, stats[2 * row + 1] = rate;
    for (int i = lane; i < n; i += LANES) y[begin + i] = (x[begin + i] - mean) * rate * gamma[i] + beta[i];
  }
}

// A lane owns columns lane, lane + LANES ...: its sums of dgamma and dbeta meet no other's.
ROWS __kernel void layer_norm_grad(__global const float* restrict x, __global const float* restrict gamma,
                                   __global const float* restrict stats, __global const float* restrict dy,
                                   __global float* restrict out, int rows, int n, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0), parts = get_num_groups(0);
  __global float* dgamma = out + (size_t)rows * n + get_group_id(0) * n;
  __global float* dbeta = dgamma + parts * n;
  for (int i = lane; i < n; i += LANES) dgamma[i] = 0.0f, dbeta[i] = 0.0f;
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    const float mean = stats[2 * row], rate = stats[2 * row + 1];
    float sum = 0.0f, sum_u = 0.0f;
    for (int i = lane; i < n; i += LANES) {
      const float u = (x[begin + i] - mean) * rate, given = dy[begin + i], d = given * gamma[i];
      dgamma[i] += given * u;
      dbeta[i] += given;
      sum += d;
      sum_u += d * u;
    }
    const float every = sum_lanes(sum, shared) / n, slope = sum_lanes(sum_u, shared) / n;
    for (int i = lane; i < n; i += LANES) {
      const float u = (x[begin + i] - mean) * rate;
      out[begin + i] = (dy[begin + i] * gamma[i] - every - u * slope) * rate;
    }
  }
}

ROWS __kernel void softmax(__global const float* restrict x, __global float* restrict y, int rows, int n, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0);
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    float top = -INFINITY, sum = 0.0f;
    for (int i = lane; i < n; i += LANES) top = fmax(top, x[begin + i]);
    top = max_lanes(top, shared);
    for (int i = lane; i < n; i += LANES) sum += m_exp(x[begin + i] - top);
    sum = sum_lanes(sum, shared);
    const float by = 1.0f / sum, log_sum = m_log(sum);
    for (int i = lane; i < n; i += LANES) {
      const float below = x[begin + i] - top;
      y[begin + i] = LOG ? below - log_sum : m_exp(below) * by;
    }
  }
}

ROWS __kernel void softmax_grad(__global const float* restrict y, __global const float* restrict dy,
                                __global float* restrict dx, int rows, int n, int chunk) {
  __local float shared[LANES];
  const int lane = get_local_id(0);
  for (int row = ROW_LO(chunk); row < ROW_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    float sum = 0.0f;
    for (int i = lane; i < n; i += LANES) sum += LOG ? dy[begin + i] : dy[begin + i] * y[begin + i];
    sum = sum_lanes(sum, shared);
    for (int i = lane; i < n; i += LANES)
      dx[begin + i] = LOG ? dy[begin + i] - m_exp(y[begin + i]) * sum : y[begin + i] * (dy[begin + i] - sum);
  }
}
