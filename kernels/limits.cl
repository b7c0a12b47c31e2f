// What the device can do at most: independent chains of fused multiply-adds, copies, changes in place.
// A CPU work-item keeps 24 registers of 16 floats busy.
__kernel FAT void peak_fma(__global float* out, int rounds) {
  float16 acc[24];
  const float16 b = (float16)(0.999f), c = (float16)(0.001f + (float)get_global_id(0) * 1e-9f);
  UNROLL for (int i = 0; i < 24; i++) acc[i] = (float16)((float)i);
  for (int r = 0; r < rounds; r++) {
    UNROLL for (int i = 0; i < 24; i++) acc[i] = acc[i] * b + c;
  }
  float16 total = (float16)(0.0f);
  UNROLL for (int i = 0; i < 24; i++) total += acc[i];
  const float8 eight = total.lo + total.hi;  // all of them: a compiler leaves out what nobody asks for
  const float4 four = eight.lo + eight.hi;
  out[get_global_id(0)] = four.x + four.y + four.z + four.w;
}

// A lane of a GPU keeps 16 floats busy, which the registers of any hold.
__kernel void peak_fma_lanes(__global float* out, int rounds) {
  float acc[16];
  const float b = 0.999f, c = 0.001f + (float)get_global_id(0) * 1e-9f;
  UNROLL for (int i = 0; i < 16; i++) acc[i] = (float)i;
  for (int r = 0; r < rounds; r++) {
    UNROLL for (int i = 0; i < 16; i++) acc[i] = acc[i] * b + c;
  }
  float total = 0.0f;
  UNROLL for (int i = 0; i < 16; i++) total += acc[i];
  out[get_global_id(0)] = total;
}

// Each round writes other numbers, so that none can be left out.
__kernel FAT void peak_copy(__global const float* restrict from, __global float* restrict to, int n, int chunk, int rounds) {
  const int end = LOOP_HI(n, chunk);
  for (int r = 0; r < rounds; r++)
    for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) to[i] = from[i] + (float)r;
}

// n counts vectors of 16.
__kernel FAT void peak_stream(__global const float16* restrict from, __global float16* restrict to, int n, int chunk) {
  const int end = LOOP_HI(n, chunk);
  for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) STORE_PAST_CACHES(from[i], to + i);
}

__kernel FAT void peak_in_place(__global float* restrict x, int n, int chunk) {
  const int end = LOOP_HI(n, chunk);
  for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) x[i] = x[i] * 0.999f + 0.001f;
}
