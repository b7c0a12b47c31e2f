// Normalisations and softmax for CPU devices: a work-item takes whole rows (or groups of channels), 16 lanes at a time.
// What it reads twice is a row that its cache still holds, so memory sees one pass. The composition in
// runtime/ops/norm.cpp is version 1.
//: variant group_norm cpu group_norm
//: variant group_norm_grad cpu group_norm_grad
//: variant layer_norm cpu layer_norm
//: variant layer_norm_grad cpu layer_norm_grad
//: variant softmax cpu softmax
//: variant softmax_grad cpu softmax_grad

// 16 values of a row of which `left` are left; `fill` beyond its end.
static inline float16 read16(__global const float* restrict x, int left, float fill) {
  if (left >= 16) return vload16(0, x);
  float part[16];
  for (int i = 0; i < 16; i++) part[i] = i < left ? x[i] : fill;
  return vload16(0, part);
}

// Mean and variance of n values, in one pass: sums of differences from the first value, which cancel less than sums of
// squares where the mean is large.
static inline float2 moments(__global const float* restrict x, int n) {
  const float centre = x[0];
  float16 sum = (float16)(0.0f), squares = (float16)(0.0f);
  for (int i = 0; i < n; i += 16) {
    const float16 d = read16(x + i, n - i, centre) - centre;
    sum += d;
    squares += d * d;
  }
  const float mean = sum16(sum) / n;
  return (float2)(centre + mean, fmax(sum16(squares) / n - mean * mean, 0.0f));
}

// With SILU the results pass through x sigmoid(x).
static inline float16 activation(float16 t) {
#if SILU
  return t * m_sigmoid16(t);
#else
  return t;
#endif
}
static inline float16 activation_slope(float16 t) {
#if SILU
  const float16 s = m_sigmoid16(t);
  return s * (1.0f + t * (1.0f - s));
#else
  return (float16)(1.0f);
#endif
}

// x [rows, channels, pixels]: a row is one group of one image, of `groups` an image. Channel c of image n is scaled by
// a[n * image_pitch + c] and shifted by b (image_pitch 0: one for all images). stats [rows, 2]: mean, 1 / deviation.
FAT __kernel void group_norm(__global const float* restrict x, __global const float* restrict a,
                             __global const float* restrict b, __global float* restrict y,
                             __global float* restrict stats, int rows, int groups, int channels, int pixels,
                             int image_pitch, float epsilon, int chunk) {
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * channels * pixels;
    const float2 moment = moments(x + begin, channels * pixels);
    const float mean = moment.x, rate = 1.0f / sqrt(moment.y + epsilon);
    stats[2 * row] = mean;
    stats[2 * row + 1] = rate;
    const int image = row / groups, first = image * image_pitch + (row - image * groups) * channels;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c] * rate, shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      for (int i = 0; i < pixels; i += 16) {
        const float16 centred = read16(x + channel + i, pixels - i, mean) - mean;
        write_first(activation(centred * scale + shift), y + channel + i, pixels - i);
      }
    }
  }
}

// With u the standardised values, t = a u + b and d = dy * activation'(t): da = sum of d u, db = sum of d over a
// channel's pixels, dx = (a d - mean(a d) - u mean(a d u)) / deviation, means over the group. da, db [images, channels].
FAT __kernel void group_norm_grad(__global const float* restrict x, __global const float* restrict a,
                                  __global const float* restrict b, __global const float* restrict stats,
                                  __global const float* restrict dy, __global float* restrict out, int rows, int groups,
                                  int channels, int pixels, int image_pitch, int chunk) {
  __global float* da = out + (size_t)rows * channels * pixels;
  __global float* db = da + rows * channels;
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * channels * pixels;
    const float mean = stats[2 * row], rate = stats[2 * row + 1];
    const int image = row / groups, first = image * image_pitch + (row - image * groups) * channels;
    float sum = 0.0f, sum_u = 0.0f;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c], shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      float16 total = (float16)(0.0f), total_u = (float16)(0.0f);
      for (int i = 0; i < pixels; i += 16) {
        const float16 u = (read16(x + channel + i, pixels - i, mean) - mean) * rate;
        const float16 d = read16(dy + channel + i, pixels - i, 0.0f) * activation_slope(u * scale + shift);
        total += d;
        total_u += d * u;
      }
      const float channel_sum = sum16(total), channel_sum_u = sum16(total_u);
      da[row * channels + c] = channel_sum_u;
      db[row * channels + c] = channel_sum;
      sum += scale * channel_sum;
      sum_u += scale * channel_sum_u;
    }
    const float n = channels * pixels, every = sum / n, slope = sum_u / n;
    for (int c = 0; c < channels; c++) {
      const float scale = a[first + c], shift = b[first + c];
      const size_t channel = begin + (size_t)c * pixels;
      for (int i = 0; i < pixels; i += 16) {
        const float16 u = (read16(x + channel + i, pixels - i, mean) - mean) * rate;
        const float16 d = read16(dy + channel + i, pixels - i, 0.0f) * activation_slope(u * scale + shift);
        write_first((d * scale - every - u * slope) * rate, out + channel + i, pixels - i);
      }
    }
  }
}

// x [rows, n], gamma and beta [n]: each row to mean 0 and variance 1, then scaled and shifted. stats [rows, 2].
FAT __kernel void layer_norm(__global const float* restrict x, __global const float* restrict gamma,
                             __global const float* restrict beta, __global float* restrict y,
                             __global float* restrict stats, int rows, int n, float epsilon, int chunk) {
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    const float2 moment = moments(x + begin, n);
    const float mean = moment.x, rate = 1.0f / sqrt(moment.y + epsilon);
    stats[2 * row] = mean;
    stats[2 * row + 1] = rate;
    for (int i = 0; i < n; i += 16) {
      const float16 u = (read16(x + begin + i, n - i, mean) - mean) * rate;
      write_first(u * read16(gamma + i, n - i, 0.0f) + read16(beta + i, n - i, 0.0f), y + begin + i, n - i);
    }
  }
}

// out: dx [rows, n], then the sums of dgamma [parts, n] and of dbeta [parts, n] over the rows of each work-item.
FAT __kernel void layer_norm_grad(__global const float* restrict x, __global const float* restrict gamma,
                                  __global const float* restrict stats, __global const float* restrict dy,
                                  __global float* restrict out, int rows, int n, int chunk) {
  __global float* dgamma = out + (size_t)rows * n + get_global_id(0) * n;
  __global float* dbeta = dgamma + get_global_size(0) * n;
  for (int i = 0; i < n; i++) dgamma[i] = 0.0f, dbeta[i] = 0.0f;
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    const float mean = stats[2 * row], rate = stats[2 * row + 1];
    float16 sum = (float16)(0.0f), sum_u = (float16)(0.0f);
    for (int i = 0; i < n; i += 16) {
      const float16 u = (read16(x + begin + i, n - i, mean) - mean) * rate, given = read16(dy + begin + i, n - i, 0.0f);
      const float16 d = given * read16(gamma + i, n - i, 0.0f);
      write_first(read16(dgamma + i, n - i, 0.0f) + given * u, dgamma + i, n - i);
      write_first(read16(dbeta + i, n - i, 0.0f) + given, dbeta + i, n - i);
      sum += d;
      sum_u += d * u;
    }
    const float every = sum16(sum) / n, slope = sum16(sum_u) / n;
    for (int i = 0; i < n; i += 16) {
      const float16 u = (read16(x + begin + i, n - i, mean) - mean) * rate;
      const float16 d = read16(dy + begin + i, n - i, 0.0f) * read16(gamma + i, n - i, 0.0f);
      write_first((d - every - u * slope) * rate, out + begin + i, n - i);
    }
  }
}

// y = exp(x) / sum of exp(x) over each row of n, or its logarithm (LOG).
FAT __kernel void softmax(__global const float* restrict x, __global float* restrict y, int rows, int n, int chunk) {
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    float16 largest = (float16)(-INFINITY), sum = (float16)(0.0f);
    for (int i = 0; i < n; i += 16) largest = fmax(largest, read16(x + begin + i, n - i, -INFINITY));
    const float top = max16(largest);
    for (int i = 0; i < n; i += 16) {
      const float16 e = m_exp16(read16(x + begin + i, n - i, -INFINITY) - top);
      sum += e;  // e^-87 beyond the end: nothing beside the largest, 1
      if (!LOG) write_first(e, y + begin + i, n - i);
    }
    const float total = sum16(sum), by = 1.0f / total, log_total = m_log(total);
    for (int i = 0; i < n; i += 16)
      write_first(LOG ? (read16(x + begin + i, n - i, 0.0f) - top) - log_total : read16(y + begin + i, n - i, 0.0f) * by,
              y + begin + i, n - i);
  }
}

// dx = y (dy - sum(y dy)); for logarithms dx = dy - exp(y) sum(dy).
FAT __kernel void softmax_grad(__global const float* restrict y, __global const float* restrict dy,
                               __global float* restrict dx, int rows, int n, int chunk) {
  for (int row = LOOP_LO(chunk); row < LOOP_HI(rows, chunk); row++) {
    const size_t begin = (size_t)row * n;
    float16 sums = (float16)(0.0f);
    for (int i = 0; i < n; i += 16) {
      const float16 d = read16(dy + begin + i, n - i, 0.0f);
      sums += LOG ? d : d * read16(y + begin + i, n - i, 0.0f);
    }
    const float sum = sum16(sums);
    for (int i = 0; i < n; i += 16) {
      const float16 d = read16(dy + begin + i, n - i, 0.0f), value = read16(y + begin + i, n - i, 0.0f);
      write_first(LOG ? d - m_exp16(value) * sum : value * (d - sum), dx + begin + i, n - i);
    }
  }
}
