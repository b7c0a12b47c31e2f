// One axis of a tensor seen as [outer, from, inner] to [outer, to, inner], and the adjoint, which gathers: no two
// work-items add into one place. A piece is a run of `inner` numbers on CPU devices, a number on GPU devices.
// version 1. Half-pixel centres: place i of `to` lies at (i + 1/2) from / to - 1/2, exact in 32 bits for sizes up to 2^14.
typedef struct {
  int low, high;
  float part;  // of the higher neighbour
} Tap;

inline Tap tap_at(int i, int from, int to) {
  Tap tap;
  const uint centre = (2u * (uint)i + 1u) * (uint)from, whole = 2u * (uint)to;
#if BILINEAR
  const uint above = centre > (uint)to ? centre - (uint)to : 0u;  // border: nothing lies before the first centre
  tap.low = (int)(above / whole);
  tap.high = min(tap.low + 1, from - 1);
  tap.part = (float)(above - (uint)tap.low * whole) / (float)whole;
#else
  tap.low = (int)(centre / whole);
  tap.high = tap.low;
  tap.part = 0.0f;
#endif
  return tap;
}

__kernel FAT void resize(__global const float* restrict in, __global float* restrict out, int pieces, int from, int to,
                         int inner, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int row = CLOAM_CPU ? piece : piece / inner;
    const int left = CLOAM_CPU ? 0 : piece % inner, right = CLOAM_CPU ? inner : left + 1;
    const Tap tap = tap_at(row % to, from, to);
    __global const float* low = in + ((size_t)(row / to) * from + tap.low) * inner;
    __global const float* high = in + ((size_t)(row / to) * from + tap.high) * inner;
    __global float* y = out + (size_t)row * inner;
    for (int k = left; k < right; k++) y[k] = low[k] * (1.0f - tap.part) + high[k] * tap.part;
  }
}

// in: the gradient [outer, to, inner]; out [outer, from, inner]. Places outside [begin, end) do not touch `own`.
__kernel FAT void resize_adjoint(__global const float* restrict in, __global float* restrict out, int pieces, int from,
                                 int to, int inner, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int row = CLOAM_CPU ? piece : piece / inner;
    const int left = CLOAM_CPU ? 0 : piece % inner, right = CLOAM_CPU ? inner : left + 1;
    const int own = row % from;
    __global float* x = out + (size_t)row * inner;
    for (int k = left; k < right; k++) x[k] = 0.0f;
    const int begin = max(0, ((2 * own - 1) * to / from - 1) / 2 - 1), end = min(to, (2 * own + 3) * to / from / 2 + 2);
    for (int i = begin; i < end; i++) {
      const Tap tap = tap_at(i, from, to);
      const float weight = (tap.low == own ? 1.0f - tap.part : 0.0f) + (tap.high == own ? tap.part : 0.0f);
      if (weight == 0.0f) continue;
      __global const float* g = in + ((size_t)(row / from) * to + i) * inner;
      for (int k = left; k < right; k++) x[k] += weight * g[k];
    }
  }
}
