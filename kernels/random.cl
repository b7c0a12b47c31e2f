// Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3",
// SC 2011). Element i is word i % 4 of the block with counter (first + i / 4, step, stream) under the key `seed`, so
// every number depends on its place alone. FORM 0 bits, 1 uniform, 2 normal, 3 below `limit`. version 1.
inline uint4 philox(uint4 counter, uint2 key) {
  UNROLL for (int round = 0; round < 10; round++) {
    const uint high0 = mul_hi(counter.x, 0xD2511F53u), low0 = counter.x * 0xD2511F53u;
    const uint high1 = mul_hi(counter.z, 0xCD9E8D57u), low1 = counter.z * 0xCD9E8D57u;
    counter = (uint4)(high1 ^ counter.y ^ key.x, low1, high0 ^ counter.w ^ key.y, low0);
    key.x += 0x9E3779B9u;
    key.y += 0xBB67AE85u;
  }
  return counter;
}

inline float unit(uint bits) { return (float)(bits >> 8) * 0x1p-24f; }

// Box-Muller: two uniforms make two independent normals. The radius takes (0, 1]: no log of zero, |z| <= 5.77.
inline float2 normal_pair(uint a, uint b) {
  const float radius = sqrt(-2.0f * m_log(unit(a) + 0x1p-24f)), angle = 6.28318530718f * unit(b);
  return (float2)(radius * m_cos(angle), radius * m_sin(angle));
}

#if FORM == 1 || FORM == 2
typedef float4 values;
typedef float value;
#else
typedef uint4 values;
typedef uint value;
#endif

inline values shaped(uint4 bits, uint limit) {
#if FORM == 1
  return (values)(unit(bits.x), unit(bits.y), unit(bits.z), unit(bits.w));
#elif FORM == 2
  return (values)(normal_pair(bits.x, bits.y), normal_pair(bits.z, bits.w));
#elif FORM == 3
  return (values)(mul_hi(bits.x, limit), mul_hi(bits.y, limit), mul_hi(bits.z, limit), mul_hi(bits.w, limit));
#else
  return bits;
#endif
}

inline values block(int i, uint first_low, uint first_high, uint step, uint stream, uint2 key, uint limit) {
  const uint low = first_low + (uint)i;
  return shaped(philox((uint4)(low, first_high + (low < first_low), step, stream), key), limit);
}

__kernel FAT void random(__global value* restrict out, int n, uint key_low, uint key_high, uint first_low, uint first_high,
                         uint step, uint stream, uint limit, int chunk) {
  const uint2 key = (uint2)(key_low, key_high);
  const int whole = n / 4;
  for (int i = LOOP_LO(chunk); i < LOOP_HI(whole, chunk); i += LOOP_STEP)
    vstore4(block(i, first_low, first_high, step, stream, key, limit), i, out);
  if (get_global_id(0) == 0 && whole * 4 < n) {
    value tail[4];
    vstore4(block(whole, first_low, first_high, step, stream, key, limit), 0, tail);
    for (int i = whole * 4; i < n; i++) out[i] = tail[i - whole * 4];
  }
}
