// The windows of an image laid out by tap, and the adjoint, which adds them up where they came from.
//   unfold: out[a,r,s,b,p,q,n] = x[a,b,p*stride+r-pad,q*stride+s-pad,n], zero outside the image
// version 1. On CPU devices a piece is a row of `out` (one tap of one image); that of fold is an image, so that no two
// work-items add into one place. On GPU devices (_each) a work-item is an element of `out`. Both add in the taps' order.

// How many of P places, from the first, see something before the image, and how many see that or the image.
static inline int places_before(int first, int stride) { return first < 0 ? (-first + stride - 1) / stride : 0; }

__kernel FAT void unfold(__global const float* restrict x, __global float* restrict out, int pieces, int B, int H,
                         int W, int N, int R, int S, int P, int Q, int stride, int pad, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int b = piece % B, tap = piece / B % (R * S), a = piece / (B * R * S);
    const int r = tap / S - pad, s = tap % S - pad;
    const int left = min(Q, places_before(s, stride)), right = max(left, min(Q, places_before(s - W, stride)));
    __global const float* image = x + (size_t)(a * B + b) * H * W * N;
    __global float* to = out + (size_t)piece * P * Q * N;
    for (int p = 0; p < P; p++, to += Q * N) {
      const int y = p * stride + r, inside = y >= 0 && y < H;
      const int begin = inside ? left * N : Q * N, end = inside ? right * N : Q * N;
      __global const float* from = image + (y * W + s) * N;
      for (int i = 0; i < begin; i++) to[i] = 0.0f;
      if (stride == 1)
        for (int i = begin; i < end; i++) to[i] = from[i];
      else
        for (int q = begin / N; q < end / N; q++)
          for (int n = 0; n < N; n++) to[q * N + n] = from[q * stride * N + n];
      for (int i = end; i < Q * N; i++) to[i] = 0.0f;
    }
  }
}

__kernel FAT void fold(__global const float* restrict g, __global float* restrict out, int pieces, int B, int H, int W,
                       int N, int R, int S, int P, int Q, int stride, int pad, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int a = piece / B, b = piece - a * B;
    __global float* to = out + (size_t)piece * H * W * N;
    for (int i = 0; i < H * W * N; i++) to[i] = 0.0f;
    for (int tap = 0; tap < R * S; tap++) {
      const int r = tap / S - pad, s = tap % S - pad;
      const int left = min(Q, places_before(s, stride)), right = max(left, min(Q, places_before(s - W, stride)));
      __global const float* from = g + (size_t)((a * R * S + tap) * B + b) * P * Q * N;
      for (int p = 0; p < P; p++, from += Q * N) {
        const int y = p * stride + r;
        if (y < 0 || y >= H) continue;
        __global float* pixels = to + (y * W + s) * N;
        if (stride == 1)
          for (int i = left * N; i < right * N; i++) pixels[i] += from[i];
        else
          for (int q = left; q < right; q++)
            for (int n = 0; n < N; n++) pixels[q * stride * N + n] += from[q * N + n];
      }
    }
  }
}

__kernel void unfold_each(__global const float* restrict x, __global float* restrict out, int elements, int B, int H,
                          int W, int N, int R, int S, int P, int Q, int stride, int pad) {
  const int i = get_global_id(0);
  if (i >= elements) return;
  const int n = i % N, place = i / N, q = place % Q, p = place / Q % P, row = place / (P * Q);
  const int b = row % B, tap = row / B % (R * S), a = row / (B * R * S);
  const int y = p * stride + tap / S - pad, column = q * stride + tap % S - pad;
  const int inside = y >= 0 && y < H && column >= 0 && column < W;
  out[i] = inside ? x[((size_t)((a * B + b) * H + y) * W + column) * N + n] : 0.0f;
}

__kernel void fold_each(__global const float* restrict g, __global float* restrict out, int elements, int B, int H,
                        int W, int N, int R, int S, int P, int Q, int stride, int pad) {
  const int i = get_global_id(0);
  if (i >= elements) return;
  const int n = i % N, pixel = i / N, image = pixel / (H * W);
  const int y = pixel / W % H + pad, x = pixel % W + pad, a = image / B, b = image - a * B;
  float sum = 0.0f;
  for (int tap = 0; tap < R * S; tap++) {
    const int down = y - tap / S, along = x - tap % S, p = down / stride, q = along / stride;
    const int meets = down >= 0 && along >= 0 && p * stride == down && q * stride == along && p < P && q < Q;
    if (meets) sum += g[((size_t)(((a * R * S + tap) * B + b) * P + p) * Q + q) * N + n];
  }
  out[i] = sum;
}
