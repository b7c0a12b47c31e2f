// What the device can do at most: independent chains of fused multiply-adds, and a copy.
// version 1: one form for both classes; a CPU work-item keeps 24 registers of 16 floats busy.
__kernel void peak_fma(__global float* out, int rounds) {
  float16 acc[24];
  const float16 b = (float16)(0.999f), c = (float16)(0.001f + (float)get_global_id(0) * 1e-9f);
  UNROLL for (int i = 0; i < 24; i++) acc[i] = (float16)((float)i);
  for (int r = 0; r < rounds; r++) {
    UNROLL for (int i = 0; i < 24; i++) acc[i] = acc[i] * b + c;
  }
  float16 total = (float16)(0.0f);
  UNROLL for (int i = 0; i < 24; i++) total += acc[i];
  out[get_global_id(0)] = total.s0 + total.s7 + total.sf;
}

__kernel void peak_copy(__global const float* restrict from, __global float* restrict to, int n, int chunk) {
  const int end = LOOP_HI(n, chunk);
  for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) to[i] = from[i];
}
