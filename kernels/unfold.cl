// The windows of an image laid out by tap, and the adjoint, which adds them up where they came from.
//   unfold: out[a,r,s,b,p,q,n] = x[a,b,p*stride+r-pad,q*stride+s-pad,n], zero outside the image
// version 1. A piece is a row of `out` (one tap of one image) with all n on CPU devices, with one n on GPU devices; that
// of fold is an image, so that no two work-items add into one place.

// How many of P places, from the first, see something before the image, and how many see that or the image.
static inline int places_before(int first, int stride) { return first < 0 ? (-first + stride - 1) / stride : 0; }

__kernel FAT void unfold(__global const float* restrict x, __global float* restrict out, int pieces, int B, int H,
                         int W, int N, int R, int S, int P, int Q, int stride, int pad, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int row = CLOAM_CPU ? piece : piece / N, shift = CLOAM_CPU ? 0 : piece - row * N;
    const int b = row % B, tap = row / B % (R * S), a = row / (B * R * S);
    const int r = tap / S - pad, s = tap % S - pad;
    const int left = min(Q, places_before(s, stride)), right = max(left, min(Q, places_before(s - W, stride)));
    __global const float* image = x + (size_t)(a * B + b) * H * W * N + shift;
    __global float* to = out + (size_t)row * P * Q * N + shift;
    for (int p = 0; p < P; p++, to += Q * N) {
      const int y = p * stride + r, inside = y >= 0 && y < H;
      const int begin = inside ? left * N : Q * N, end = inside ? right * N : Q * N;
      __global const float* from = image + (y * W + s) * N;
      for (int i = 0; i < begin; i += CLOAM_CPU ? 1 : N) to[i] = 0.0f;
      if (CLOAM_CPU && stride == 1)
        for (int i = begin; i < end; i++) to[i] = from[i];
      else
        for (int q = begin / N; q < end / N; q++)
          for (int n = 0; n < (CLOAM_CPU ? N : 1); n++) to[q * N + n] = from[q * stride * N + n];
      for (int i = end; i < Q * N; i += CLOAM_CPU ? 1 : N) to[i] = 0.0f;
    }
  }
}

__kernel FAT void fold(__global const float* restrict g, __global float* restrict out, int pieces, int B, int H, int W,
                       int N, int R, int S, int P, int Q, int stride, int pad, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int image = CLOAM_CPU ? piece : piece / N, shift = CLOAM_CPU ? 0 : piece - image * N;
    const int a = image / B, b = image - a * B;
    __global float* to = out + (size_t)image * H * W * N + shift;
    for (int i = 0; i < H * W * N; i += CLOAM_CPU ? 1 : N) to[i] = 0.0f;
    for (int tap = 0; tap < R * S; tap++) {
      const int r = tap / S - pad, s = tap % S - pad;
      const int left = min(Q, places_before(s, stride)), right = max(left, min(Q, places_before(s - W, stride)));
      __global const float* from = g + (size_t)((a * R * S + tap) * B + b) * P * Q * N + shift;
      for (int p = 0; p < P; p++, from += Q * N) {
        const int y = p * stride + r;
        if (y < 0 || y >= H) continue;
        __global float* pixels = to + (y * W + s) * N;
        if (CLOAM_CPU && stride == 1)
          for (int i = left * N; i < right * N; i++) pixels[i] += from[i];
        else
          for (int q = left; q < right; q++)
            for (int n = 0; n < (CLOAM_CPU ? N : 1); n++) pixels[q * stride * N + n] += from[q * N + n];
      }
    }
  }
}
