// Adam (Kingma and Ba, ICLR 2015) in place, with AdamW's decoupled weight decay (Loshchilov and Hutter, ICLR 2019):
//   m = b1 m + (1 - b1) g,  v = b2 v + (1 - b2) g^2,
//   p -= rate (m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + eps) + decay p).
// version 1.
static inline void step_one(__global float* p, __global float* m, __global float* v, float g, float beta1, float beta2,
                            float rate_m, float scale_v, float epsilon, float shrink) {
  const float mean = *m + (1.0f - beta1) * (g - *m), square = *v + (1.0f - beta2) * (g * g - *v);
  *m = mean;
  *v = square;
  *p = *p * shrink - rate_m * mean / (sqrt(square) * scale_v + epsilon);
}

// Of the n values from `first` on. rate_m = rate / (1 - b1^t), scale_v = 1 / sqrt(1 - b2^t), shrink = 1 - rate decay.
__kernel FAT void adam(__global float* restrict p, __global float* restrict m, __global float* restrict v,
                       __global const float* g, int first, int n, float beta1, float beta2, float rate_m, float scale_v,
                       float epsilon, float shrink, int chunk) {
  for (int i = first + LOOP_LO(chunk); i < first + LOOP_HI(n, chunk); i += LOOP_STEP)
    step_one(p + i, m + i, v + i, g[i], beta1, beta2, rate_m, scale_v, epsilon, shrink);
}

// 1 - e^x for x <= 0 without cancellation near 0: the series there.
static inline float one_minus_exp(float x) {
  const float series =
      -x * (1.0f + x * (0.5f + x * (1.0f / 6 + x * (1.0f / 24 + x * (1.0f / 120 + x * (1.0f / 720))))));
  return x > -0.3f ? series : 1.0f - m_exp(x);
}

// Rows with a gradient of zeros stay as they are; each other row counts its own steps t, and b^t = e^(t log b). Of the
// `rows` rows from `first` on.
__kernel FAT void adam_rows(__global float* restrict p, __global float* restrict m, __global float* restrict v,
                            __global int* restrict steps, __global const float* g, int first, int rows, int width,
                            float beta1, float beta2, float log_beta1, float log_beta2, float rate, float epsilon,
                            float shrink, int chunk) {
  for (int row = first + LOOP_LO(chunk); row < first + LOOP_HI(rows, chunk); row += LOOP_STEP) {
    const size_t at = (size_t)row * width;
    int touched = 0;
    for (int c = 0; c < width; c++) touched |= g[at + c] != 0.0f;
    if (touched) {
      const float t = (float)(++steps[row]);
      const float rate_m = rate / one_minus_exp(t * log_beta1), scale_v = 1.0f / sqrt(one_minus_exp(t * log_beta2));
      for (int c = 0; c < width; c++)
        step_one(p + at + c, m + at + c, v + at + c, g[at + c], beta1, beta2, rate_m, scale_v, epsilon, shrink);
    }
  }
}
