// Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2,
// 3", SC 2011). Element i is word i % 4 of the block with counter (first + i / 4, step, stream) under the key `seed`,
// so every number depends on its place alone. FORM 0 bits, 1 uniform, 2 normal, 3 below `limit`. version 1.

// The upper half of a product. PoCL's mul_hi is five times slower.
static inline uint high(uint a, uint b) { return (uint)((ulong)a * b >> 32); }

static inline void philox(uint* c, uint key_low, uint key_high) {
  UNROLL for (int round = 0; round < 10; round++) {
    const uint high0 = high(c[0], 0xD2511F53u), low0 = c[0] * 0xD2511F53u;
    const uint high1 = high(c[2], 0xCD9E8D57u), low1 = c[2] * 0xCD9E8D57u;
    c[0] = high1 ^ c[1] ^ key_low;
    c[1] = low1;
    c[2] = high0 ^ c[3] ^ key_high;
    c[3] = low0;
    key_low += 0x9E3779B9u;
    key_high += 0xBB67AE85u;
  }
}

static inline float unit(uint bits) { return (float)(bits >> 8) * 0x1p-24f; }

// Number `odd` of the two that words a and b make.
#if FORM == 1
typedef float value;
static inline value shaped(uint a, uint b, int odd, uint limit) { return unit(odd ? b : a); }
#elif FORM == 2
typedef float value;
// Box-Muller: two uniforms make two independent normals. The radius takes (0, 1]: no log of zero, |z| <= 5.77.
static inline value shaped(uint a, uint b, int odd, uint limit) {
  const float radius = sqrt(-2.0f * m_log(unit(a) + 0x1p-24f)), angle = 6.28318530718f * unit(b);
  return radius * (odd ? m_sin(angle) : m_cos(angle));
}
#elif FORM == 3
typedef uint value;
static inline value shaped(uint a, uint b, int odd, uint limit) { return high(odd ? b : a, limit); }
#else
typedef uint value;
static inline value shaped(uint a, uint b, int odd, uint limit) { return odd ? b : a; }
#endif

__kernel FAT void random(__global value* restrict out, int n, uint key_low, uint key_high, uint first_low,
                         uint first_high, uint step, uint stream, uint limit, int chunk) {
  const int blocks = n / 4, end = LOOP_HI(blocks, chunk);
  for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) {
    const uint low = first_low + (uint)i;
    uint c[4] = {low, first_high + (low < first_low), step, stream};
    philox(c, key_low, key_high);
    UNROLL for (int k = 0; k < 4; k++) out[4 * i + k] = shaped(c[k & 2], c[k | 1], k & 1, limit);
  }
  if (get_global_id(0) != 0) return;
  for (int i = blocks * 4; i < n; i++) {  // the last block has fewer than four numbers
    const uint low = first_low + (uint)blocks;
    uint c[4] = {low, first_high + (low < first_low), step, stream};
    philox(c, key_low, key_high);
    const int odd = i & 1, pair = i & 2;
    out[i] = shaped(pair ? c[2] : c[0], pair ? c[3] : c[1], odd, limit);
  }
}
