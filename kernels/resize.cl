// One axis of a tensor seen as [outer, from, inner] to [outer, to, inner], and the adjoint, which gathers: no two
// work-items add into one place. A piece is a run of `inner` numbers on CPU devices, a number on GPU devices.
// Half-pixel centres: place i of `to` lies at (i + 1/2) from / to - 1/2, exact in 32 bits for sizes up to 2^14.
// version 1
//: variant resize reference any
// version 2, of the last axis (inner = 1), where finding a place's tap costs more than its number: once for LINES lines.
//: variant resize_lines cpu lines
enum { LINES = 16 };

typedef struct {
  int low, high;
  float part;  // of the higher neighbour
} Tap;

static inline Tap tap_at(int i, int from, int to) {
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

__kernel FAT void resize_lines(__global const float* restrict in, __global float* restrict out, int pieces, int lines,
                               int from, int to, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int count = min((int)LINES, lines - piece * LINES);
    __global const float* first = in + (size_t)piece * LINES * from;
    __global float* y = out + (size_t)piece * LINES * to;
    for (int i = 0; i < to; i++) {
      const Tap tap = tap_at(i, from, to);
      for (int line = 0; line < count; line++) {
        const float low = first[line * from + tap.low], high = first[line * from + tap.high];
        y[line * to + i] = low * (1.0f - tap.part) + high * tap.part;
      }
    }
  }
}

// A work-item has whole lines, so it may add into its places, in the order in which version 1 gathers.
__kernel FAT void resize_lines_adjoint(__global const float* restrict in, __global float* restrict out, int pieces,
                                       int lines, int from, int to, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int count = min((int)LINES, lines - piece * LINES);
    __global const float* g = in + (size_t)piece * LINES * to;
    __global float* first = out + (size_t)piece * LINES * from;
    for (int k = 0; k < count * from; k++) first[k] = 0.0f;
    for (int i = 0; i < to; i++) {
      const Tap tap = tap_at(i, from, to);
      const bool border = tap.high == tap.low;
      const float low = 1.0f - tap.part + (border ? tap.part : 0.0f), high = border ? 0.0f : tap.part;
      for (int line = 0; line < count; line++) first[line * from + tap.low] += low * g[line * to + i];
      if (high == 0.0f) continue;
      for (int line = 0; line < count; line++) first[line * from + tap.high] += high * g[line * to + i];
    }
  }
}
