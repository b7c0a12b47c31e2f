// Put before every program: device-class macros and branch-free maths that vectorises (built-in scalar exp2, log, sin,
// pow and erf are calls that stop it) and gives one result on every device. Cephes-style polynomials, errors in ulp below.
#define UNROLL _Pragma("unroll")
#define INLINE static inline __attribute__((always_inline))
#if CLOAM_CPU
// A work-item is a core's loop: groups of one, contiguous chunks.
#define FAT __attribute__((reqd_work_group_size(1, 1, 1)))
#define LOOP_LO(chunk) ((int)get_global_id(0) * (chunk))
#define LOOP_HI(n, chunk) min((n), ((int)get_global_id(0) + 1) * (chunk))
#define LOOP_STEP 1
#else
// A work-item is a lane: groups of 64, neighbours side by side.
#define FAT
#define LOOP_LO(chunk) ((int)get_global_id(0))
#define LOOP_HI(n, chunk) (n)
#define LOOP_STEP ((int)get_global_size(0))
#endif

// A vector of a cache line, or half of one and then the other, to where nothing is read soon: it does not fetch the line
// first. `to` is aligned.
#define STORE_PAST_CACHES(value, to) (*(to) = (value))
#if CLOAM_CPU && defined(__has_builtin)
#if __has_builtin(__builtin_nontemporal_store)
#undef STORE_PAST_CACHES
#define STORE_PAST_CACHES(value, to) __builtin_nontemporal_store(value, to)
#endif
#endif

// Of kernels that copy whatever has so many bytes.
#if BYTES == 1
typedef uchar element;
#elif BYTES == 2
typedef ushort element;
#elif BYTES == 4
typedef uint element;
#elif BYTES == 8
typedef ulong element;
#endif

#if CLOAM_FLOAT64
#define m_exp exp
#define m_log log
#define m_sin sin
#define m_cos cos
#define m_tanh tanh
#define m_erf erf
#define m_pow pow
static inline float m_sigmoid(float x) { return 1.0f / (1.0f + exp(-x)); }
static inline float m_softplus(float x) { return fmax(x, 0.0f) + log1p(exp(-fabs(x))); }
static inline float m_half(float x) {
  const float step = ldexp(1.0f, max(ilogb(x), -14) - 10), y = rint(x / step) * step;
  return x == 0.0f || x != x || isinf(x) ? x : fabs(y) > 65504.0f ? copysign(INFINITY, y) : y;
}
#else
// The nearest number of half precision, ties to even: 11 bits from 2^-14 on, below it multiples of 2^-24, from 65520 on
// inf. In registers, so that what is stored in half and what is computed again instead are the same.
static inline float m_half(float x) {
  const uint bits = as_uint(x), sign = bits & 0x80000000u;
  const float a = fabs(x), tiny = (a + 0.5f) - 0.5f;  // a sum in [0.5, 1) ends at 2^-24
  const uint rounded = (bits + 0xfffu + (bits >> 13 & 1u)) & 0xffffe000u;
  const float y = as_float(a < 6.103515625e-5f ? as_uint(tiny) | sign : rounded);
  return x != x ? x : a >= 65520.0f ? as_float(0x7f800000u | sign) : y;
}

// exp, 2 ulp: 2^n * p(f), |f| <= ln2/2. 0 below -87, where subnormal numbers begin, which take CPUs a hundred times as long
// (erf, sigmoid and tanh of large numbers made nothing else); inf above the float range.
static inline float m_exp(float x) {
  const float c = fmin(fmax(x, -87.0f), 89.0f);
  const float t = c * 1.44269504089f + 12582912.0f;  // adding 1.5 * 2^23 rounds to an integer in the low bits
  const int n = as_int(t) - 0x4b400000;
  const float r = t - 12582912.0f;
  const float f = (c - r * 0.693359375f) + r * 2.12194440e-4f;
  float p = 1.9875691500e-4f;
  p = p * f + 1.3981999507e-3f;
  p = p * f + 8.3334519073e-3f;
  p = p * f + 4.1665795894e-2f;
  p = p * f + 1.6666665459e-1f;
  p = p * f + 5.0000001201e-1f;
  p = p * f * f + f + 1.0f;
  const int half_n = n >> 1;  // two factors: 2^n alone overflows at the end
  const float y = p * as_float((half_n + 127) << 23) * as_float((n - half_n + 127) << 23);
  return x < -87.0f ? 0.0f : x != x ? x : y;
}

// log, 2 ulp for normal x > 0; -inf at 0, nan below.
static inline float m_log(float x) {
  const int bits = as_int(x);
  int e = ((bits >> 23) & 255) - 126;
  float m = as_float((bits & 0x007fffff) | 0x3f000000);
  const int low = m < 0.707106781f;
  e -= low;
  m = (low ? m + m : m) - 1.0f;
  const float z = m * m;
  float p = 7.0376836292e-2f;
  p = p * m - 1.1514610310e-1f;
  p = p * m + 1.1676998740e-1f;
  p = p * m - 1.2420140846e-1f;
  p = p * m + 1.4249322787e-1f;
  p = p * m - 1.6668057665e-1f;
  p = p * m + 2.0000714765e-1f;
  p = p * m - 2.4999993993e-1f;
  p = p * m + 3.3333331174e-1f;
  const float k = (float)e;
  float y = m * z * p + k * -2.12194440e-4f - 0.5f * z;
  y = m + y + k * 0.693359375f;
  y = x == INFINITY ? INFINITY : y;
  y = x == 0.0f ? -INFINITY : y;
  return x < 0.0f || x != x ? NAN : y;
}

// sin and cos, 2 ulp for |x| < 8192 (three-part pi/4 reduction).
static inline float m_sincos(float x, int quadrant) {
  const float a = fabs(x);
  const float t = a * 0.636619772f + 12582912.0f;
  const int n = as_int(t) - 0x4b400000;
  const float r = t - 12582912.0f;
  const float f = ((a - r * 1.5703125f) - r * 4.837512969970703125e-4f) - r * 7.54978995489188216e-8f;
  const float z = f * f;
  const float s = ((-1.9515295891e-4f * z + 8.3321608736e-3f) * z - 1.6666654611e-1f) * z * f + f;
  const float c = ((2.443315711809948e-5f * z - 1.388731625493765e-3f) * z + 4.166664568298827e-2f) * z * z - 0.5f * z + 1.0f;
  const int q = n + quadrant;
  const float y = (q & 1) ? c : s;
  const float y_signed = (q & 2) ? -y : y;
  return quadrant == 0 && x < 0.0f ? -y_signed : y_signed;
}
static inline float m_sin(float x) { return m_sincos(x, 0); }
static inline float m_cos(float x) { return m_sincos(x, 1); }

static inline float m_sigmoid(float x) { return 1.0f / (1.0f + m_exp(-x)); }

// tanh: odd polynomial near 0 (no cancellation), else through exp.
static inline float m_tanh(float x) {
  const float a = fabs(x), z = x * x;
  const float e = m_exp(-2.0f * a);
  const float far = (1.0f - e) / (1.0f + e);
  float p = -5.70498872745e-3f;
  p = p * z + 2.06390887954e-2f;
  p = p * z - 5.37397155531e-2f;
  p = p * z + 1.33314422036e-1f;
  p = p * z - 3.33332819422e-1f;
  const float near = p * z * x + x;
  return a < 0.625f ? near : (x < 0.0f ? -far : far);
}

// log(1 + exp(x)) without overflow. INLINE: what a compiler finds too long to put into the loop keeps it from vectorising.
INLINE float m_softplus(float x) {
  const float e = m_exp(-fabs(x)), u = 1.0f + e;
  // log1p by the classic correction: exact where u rounds.
  const float l = u == 1.0f ? e : m_log(u) * (e / (u - 1.0f));
  return fmax(x, 0.0f) + l;
}

// erf, |error| < 6e-7: Taylor-like series near 0, Abramowitz-Stegun 7.1.26-style rational in exp beyond.
INLINE float m_erf(float x) {
  const float a = fabs(x), z = x * x;
  float p = 7.853861353153693e-5f;
  p = p * z - 8.010193625184903e-4f;
  p = p * z + 5.188327685732524e-3f;
  p = p * z - 2.685381193529856e-2f;
  p = p * z + 1.128358514861418e-1f;
  p = p * z - 3.761262582423300e-1f;
  p = p * z + 1.128379165726710e+0f;
  const float near = p * x;
  const float t = 1.0f / (1.0f + 0.5f * a);
  float q = 0.17087277f;
  q = q * t - 0.82215223f;
  q = q * t + 1.48851587f;
  q = q * t - 1.13520398f;
  q = q * t + 0.27886807f;
  q = q * t - 0.18628806f;
  q = q * t + 0.09678418f;
  q = q * t + 0.37409196f;
  q = q * t + 1.00002368f;
  q = q * t - 1.26551223f;
  const float far = 1.0f - t * m_exp(-z + q);
  return a < 1.0f ? near : (x < 0.0f ? -far : far);
}

// x^y for x >= 0 by exp and log; relative error grows with |y log x|. Exact at y = 0 and x = 0.
INLINE float m_pow(float x, float y) {
  const float r = m_exp(y * m_log(x));
  return y == 0.0f ? 1.0f : (x == 0.0f ? (y > 0.0f ? 0.0f : INFINITY) : r);
}
#endif

#if CLOAM_CPU
// ---- 16 lanes at once, for loops over vectors.
// As vstore16(value, 0, to), which PoCL makes four stores of: slower, and a load of the whole would wait for all of them.
typedef float16 float16_anywhere __attribute__((aligned(4)));
static inline void __attribute__((overloadable)) store16(float16 value, __global float* to) {
  *(__global float16_anywhere*)to = value;
}
static inline void __attribute__((overloadable)) store16(float16 value, __local float* to) {
  *(__local float16_anywhere*)to = value;
}
#define LANE_NUMBERS ((int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
// Of running sums over 2, 4, 8 and 16 lanes: what the upper half of the lanes gets from the last of the lower half, the
// lower half `none`. v = v + BELOW1(v, none) ... BELOW8(v, none): sums of numbers >= 0 never step down.
#define BELOW1(v, none) select(none, (v).s0022446688aaccee, (LANE_NUMBERS & 1) != 0)
#define BELOW2(v, none) select(none, (v).s111155559999dddd, (LANE_NUMBERS & 2) != 0)
#define BELOW4(v, none) select(none, (v).s33333333bbbbbbbb, (LANE_NUMBERS & 4) != 0)
#define BELOW8(v, none) select(none, (v).s7777777777777777, (LANE_NUMBERS & 8) != 0)
// Each lane gets the one before it, the first one `none`.
#define ONE_BEFORE(v, none) select(none, (v).s00123456789abcde, LANE_NUMBERS != 0)
// 16 numbers of which `mine` count, 0 in the place of the others; `there` can be read.
INLINE float16 read_first(__global const float* from, int mine, int there) {
  if (there >= 16) return select((float16)(0.0f), vload16(0, from), LANE_NUMBERS < mine);
  float part[16];
  for (int i = 0; i < 16; i++) part[i] = i < min(mine, there) ? from[i] : 0.0f;
  return vload16(0, part);
}
INLINE void write_first(float16 v, __global float* to, int mine) {
  if (mine >= 16) {
    store16(v, to);
  } else {
    float part[16];
    vstore16(v, 0, part);
    for (int i = 0; i < mine; i++) to[i] = part[i];
  }
}
static inline float sum16(float16 v) {
  const float8 h = v.lo + v.hi;
  const float4 q = h.lo + h.hi;
  return (q.x + q.y) + (q.z + q.w);
}
static inline float max16(float16 v) {
  const float8 h = fmax(v.lo, v.hi);
  const float4 q = fmax(h.lo, h.hi);
  return fmax(fmax(q.x, q.y), fmax(q.z, q.w));
}
// 2^(n + f) for n = t - 1.5 * 2^23 and |f| <= 1/2 by a minimax polynomial of degree 5: relative error 2e-7.
static inline float16 m_exp2_parts16(float16 t, float16 f) {
  float16 p = (float16)(1.3276472e-3f);
  p = p * f + 9.6755413e-3f;
  p = p * f + 5.5507133e-2f;
  p = p * f + 2.4022120e-1f;
  p = p * f + 6.9314697e-1f;
  p = p * f + 1.0f;
  return p * as_float16((as_int16(t) + 127) << 23);  // the shift drops all bits but those of n + 127
}
// Beyond +-125, and exp beyond +-87, results stay what they are there: 2.4e-38 is the least. nan stays nan.
static inline float16 m_exp2_16(float16 x) {
  const float16 low = x < -125.0f ? (float16)(-125.0f) : x;
  const float16 c = low > 125.0f ? (float16)(125.0f) : low;
  const float16 t = c + 12582912.0f;  // adding 1.5 * 2^23 rounds to an integer in the low bits
  return m_exp2_parts16(t, c - (t - 12582912.0f));
}
static inline float16 m_exp16(float16 x) {
  const float16 low = x < -87.0f ? (float16)(-87.0f) : x;
  const float16 c = low > 87.0f ? (float16)(87.0f) : low;
  const float16 t = c * 1.44269504f + 12582912.0f;
  return m_exp2_parts16(t, c * 1.44269504f - (t - 12582912.0f));
}
static inline float16 m_sigmoid16(float16 x) { return 1.0f / (1.0f + m_exp16(-x)); }
#endif

// The end of products and convolutions (ops.h: Epilogue): activation(sum + bias + residual). Flags are an argument, so
// that one kernel text serves all: tested once a tile, not once an element.
#define EPILOGUE_BIAS 1
#define EPILOGUE_RESIDUAL 2
#define EPILOGUE_RELU 4
#define EPILOGUE_SILU 8
static inline float activate(float x, int epilogue) {
  if (epilogue & EPILOGUE_RELU) return fmax(x, 0.0f);
  return epilogue & EPILOGUE_SILU ? x * m_sigmoid(x) : x;
}
#if CLOAM_CPU
static inline float16 activate16(float16 x, int epilogue) {
  if (epilogue & EPILOGUE_RELU) return fmax(x, (float16)(0.0f));
  return epilogue & EPILOGUE_SILU ? x * m_sigmoid16(x) : x;
}
static inline void transpose16(float16 r[16]) {
  float16 t[16];
  UNROLL for (int stage = 0; stage < 4; stage++) {  // four perfect shuffles of rows make a transpose
    UNROLL for (int i = 0; i < 8; i++) {
      const float16 p = r[i], q = r[i + 8];
      t[2 * i] =
          (float16)(p.s0, q.s0, p.s1, q.s1, p.s2, q.s2, p.s3, q.s3, p.s4, q.s4, p.s5, q.s5, p.s6, q.s6, p.s7, q.s7);
      t[2 * i + 1] =
          (float16)(p.s8, q.s8, p.s9, q.s9, p.sa, q.sa, p.sb, q.sb, p.sc, q.sc, p.sd, q.sd, p.se, q.se, p.sf, q.sf);
    }
    UNROLL for (int i = 0; i < 16; i++) r[i] = t[i];
  }
}
#endif
