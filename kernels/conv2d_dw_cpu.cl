// Gradient of a convolution's weights for CPU devices: a matrix product whose depth is the pixels, of the result's
// gradient (DR filters) and the input (CB channels, packed side by side for each pixel of a tile). Padded places take no
// part. Where channels are few, every tap of a channel is a channel of its own (`unfold`), so that vectors fill.
//: variant conv2d_dw_tiles cpu wide CB=64 DR=8 DV=2
//: variant conv2d_dw_tiles cpu half CB=32 DR=8 DV=2
//: variant conv2d_dw_tiles cpu narrow CB=16 DR=8 DV=1
//: variant conv2d_dw_tiles cpu few CB=64 DR=4 DV=4
//: variant conv2d_dw_planes cpu single CB=16 DR=1 DV=1

typedef struct {
  int offset, y, x;  // where a channel of the product lies: floats from the first channel; rows and columns moved
} Lane;

// 16 pixels of a row, from `column` on, for 16 lanes of which `count` are there. Up to `readable` floats from `from` on
// may be read where what lies outside the row does not matter.
static inline void load_lanes(float16 r[16], __global const float* restrict from, long readable,
                              __local const Lane* restrict lanes, int count, int y, int column, int H, int W) {
  UNROLL for (int i = 0; i < 16; i++) {
    r[i] = (float16)(0.0f);
    const Lane lane = lanes[i];
    const int row = y + lane.y, first = column + lane.x;
    if (i < count && row >= 0 && row < H) {
      const long at = lane.offset + (long)row * W + first;
      if (first >= 0 && (first + 16 <= W || at + 16 <= readable)) {
        r[i] = vload16(0, from + at);
        __builtin_prefetch(from + at + W);  // the next row
      } else {
        float some[16];
        for (int j = 0; j < 16; j++) some[j] = first + j >= 0 && first + j < W ? from[at + j] : 0.0f;
        r[i] = vload16(0, some);
      }
    }
  }
}

// Input tile -> [height][width][CB], channels innermost, zeros beyond the last channel and, for lanes that are moved,
// outside the image; what lies outside the image otherwise is not read later and left alone.
static inline void pack_tile(__local float* restrict to, __global const float* restrict from, long readable,
                             __local const Lane* restrict lanes, int channels, int H, int W, int y0, int x0, int height,
                             int width, int moved) {
  const int begin = moved ? 0 : max(0, -x0), end = moved ? width : min(width, W - x0);
  for (int h = 0; h < height; h++) {
    if (!moved && (y0 + h < 0 || y0 + h >= H)) continue;
    // Blocks of 16 from a multiple of 16 on: a line of the cache is read once, which matters where channels lie a power
    // of two apart and share a few places of the cache.
    for (int c = 0; c < CB; c += 16)
      for (int q = moved ? 0 : begin - (x0 + begin) % 16; q < end; q += 16) {
        float16 r[16];
        load_lanes(r, from, moved ? 0 : readable, lanes + c, channels - c, y0 + h, x0 + q, H, W);
        transpose16(r);
        UNROLL for (int i = 0; i < 16; i++) {
          if (q + i >= begin && q + i < end) store16(r[i], to + ((long)h * width + q + i) * CB + c);
        }
      }
  }
}

// acc += sum over pixels p in [p0, p1), q in [q0, q1) of g[i][p, q] x[p, q][channel].
static inline void micro_pixels(float16 acc[DR][DV], __local const float* restrict x, __local const float* restrict g, int p0,
                                int p1, int q0, int q1, int x_row, int x_step, int g_row, int g_pitch) {
  for (int p = p0; p < p1; p++) {
    __local const float* b = x + p * x_row;
    __local const float* a = g + p * g_row;
#pragma unroll 2
    for (int q = q0; q < q1; q++) {
      float16 value[DV];
      UNROLL for (int v = 0; v < DV; v++) value[v] = vload16(v, b + q * x_step);
      UNROLL for (int i = 0; i < DR; i++) {
        const float16 d = (float16)(a[i * g_pitch + q]);
        UNROLL for (int v = 0; v < DV; v++) acc[i][v] += d * value[v];
      }
    }
  }
}

// Results [lo, hi) of `size` that meet the input at tap t.
static inline int first_met(int t, int stride, int pad) { return max(0, (pad - t + stride - 1) / stride); }
static inline int last_met(int t, int stride, int pad, int size, int n) {
  return n + pad - t <= 0 ? 0 : min(size, (n + pad - t - 1) / stride + 1);
}

// dw[c][t] = sums[t][c] for CB channels of one filter.
static inline void store_filter(__global float* restrict dw, __local const float* restrict sums, int taps, int pitch,
                                int channels) {
  for (int c = 0; c < channels; c += 16)
    for (int t0 = 0; t0 < taps; t0 += 16) {
      float16 r[16];
      float rows[256];
      UNROLL for (int t = 0; t < 16; t++) {
        r[t] = t0 + t < taps ? vload16(0, sums + (t0 + t) * pitch + c) : (float16)(0.0f);
      }
      transpose16(r);
      UNROLL for (int i = 0; i < 16; i++) vstore16(r[i], i, rows);
      for (int i = 0; i < min(16, channels - c); i++)
        for (int t = 0; t < min(16, taps - t0); t++) dw[(c + i) * taps + t0 + t] = rows[i * 16 + t];
    }
}

// Group (p, b): part p of `parts` adds up tiles p, p + parts, .. into its own partial [R * S][K8][C8] (per group; K8, C8:
// rounded up to DR and CB), for the b-th (group, block of filters, CB channels). conv2d_dw_sum joins the parts. A tile is
// tile_images x tile_rows x tile_columns pixels; where one tile is all, the result is stored at once.
FAT __kernel void conv2d_dw_tiles(__global const float* restrict x, __global const float* restrict g,
                                  __global float* restrict partial, __global float* restrict dw, int N, int channels,
                                  int H, int W, int filters, int P, int Q, int R, int S, int stride, int pad,
                                  int tile_images, int tile_rows, int tile_columns, int block_filters, int groups,
                                  int parts, int unfold, int at_once) {
  __local float pixels[TILE] __attribute__((aligned(64)));
  __local float rows[DR * GROW] __attribute__((aligned(64)));
  __local float sums[DR * CB * TAPS] __attribute__((aligned(64)));
  __local Lane lanes[CB];
  const int product_channels = unfold ? channels * R * S : channels, taps = unfold ? 1 : R * S;
  const int k_blocks = (filters + block_filters - 1) / block_filters, c_blocks = (product_channels + CB - 1) / CB;
  const int group = get_group_id(1) / (k_blocks * c_blocks), rest = get_group_id(1) - group * k_blocks * c_blocks;
  const int k_first = rest / c_blocks * block_filters, c_first = (rest % c_blocks) * CB;
  const int k_last = min(filters, k_first + block_filters), c_count = min(CB, product_channels - c_first);
  const int across = (Q + tile_columns - 1) / tile_columns, down = (P + tile_rows - 1) / tile_rows;
  const int tiles = across * down * ((N + tile_images - 1) / tile_images);
  const int K8 = (filters + DR - 1) / DR * DR, C8 = c_blocks * CB;
  const int width = (tile_columns - 1) * stride + (unfold ? 1 : S), x_row = width * stride * CB;
  const int x_image = ((tile_rows - 1) * stride + (unfold ? 1 : R)) * width * CB;
  const int g_image = tile_rows * tile_columns, pitch = tile_images * g_image;
  partial += at_once ? 0 : ((size_t)get_group_id(0) * groups + group) * taps * K8 * C8;
  for (int i = 0; i < c_count; i++) {
    const int c = unfold ? (c_first + i) / (R * S) : c_first + i, tap = unfold ? (c_first + i) % (R * S) : 0;
    lanes[i] = (Lane){c * H * W, unfold ? tap / S - pad : 0, unfold ? tap % S - pad : 0};
  }

  for (int t = get_group_id(0); t < tiles; t += parts) {
    const int n0 = t / (across * down) * tile_images, ty = t / across % down, tx = t % across;
    const int images = min(tile_images, N - n0), p0 = ty * tile_rows, q0 = tx * tile_columns;
    const int p_end = min(tile_rows, P - p0), q_end = min(tile_columns, Q - q0);
    for (int n = 0; n < images; n++) {
      const long image = ((long)(n0 + n) * groups + group) * channels * H * W;
      pack_tile(pixels + n * x_image, x + image, (long)N * groups * channels * H * W - image, lanes, c_count, H, W, p0 * stride - (unfold ? 0 : pad), q0 * stride - (unfold ? 0 : pad),
                (p_end - 1) * stride + (unfold ? 1 : R), width, unfold);
    }
    for (int k = k_first; k < k_last; k += DR) {
      for (int i = 0; i < DR; i++)
        for (int n = 0; n < images; n++)
          for (int p = 0; p < p_end; p++) {
            const size_t filter = ((size_t)(n0 + n) * groups + group) * filters + min(k + i, filters - 1);
            __global const float* from = g + (filter * P + p0 + p) * Q + q0;
            __local float* to = rows + i * pitch + n * g_image + p * tile_columns;
            for (int q = 0; q < q_end; q += 16) __builtin_prefetch(from + 2 * P * Q + q);  // two filters on
            for (int q = 0; q < q_end; q++) to[q] = from[q];
          }
      for (int tap = 0; tap < taps; tap++)
        for (int c = 0; c < CB; c += DV * 16) {
          const int r = tap / S, s = tap - r * S;
          const int p_lo = unfold ? 0 : first_met(r, stride, pad) - p0, q_lo = unfold ? 0 : first_met(s, stride, pad) - q0;
          const int p_hi = unfold ? p_end : last_met(r, stride, pad, P, H) - p0;
          const int q_hi = unfold ? q_end : last_met(s, stride, pad, Q, W) - q0;
          __global float* to = partial + ((size_t)tap * K8 + k) * C8 + c_first + c;
          float16 acc[DR][DV];
          UNROLL for (int i = 0; i < DR; i++) UNROLL for (int v = 0; v < DV; v++) {
            acc[i][v] = t < parts ? (float16)(0.0f) : vload16(v, to + (size_t)i * C8);
          }
          for (int n = 0; n < images; n++)
            micro_pixels(acc, pixels + n * x_image + (r * width + s) * CB + c, rows + n * g_image, max(0, p_lo),
                         min(p_end, p_hi), max(0, q_lo), min(q_end, q_hi), x_row, stride * CB, tile_columns, pitch);
          if (at_once) {
            UNROLL for (int i = 0; i < DR; i++) UNROLL for (int v = 0; v < DV; v++)
                store16(acc[i][v], sums + (i * taps + tap) * CB + c + v * 16);
          } else {
            UNROLL for (int i = 0; i < DR; i++) UNROLL for (int v = 0; v < DV; v++)
                store16(acc[i][v], to + (size_t)i * C8 + v * 16);
          }
        }
      if (at_once)
        for (int i = 0; i < min(DR, k_last - k); i++)
          store_filter(dw + ((size_t)(group * filters + k + i) * product_channels + c_first) * taps,
                       sums + i * taps * CB, taps, CB, c_count);
    }
  }
}

// dw[k][c][tap] = sum over parts, in order, of partial[part][group][tap][k][c]. Group (k, c): a filter, CB channels.
FAT __kernel void conv2d_dw_sum(__global const float* restrict partial, __global float* restrict dw, int channels,
                                int filters, int taps, int groups, int parts) {
  __local float sums[16 * CB] __attribute__((aligned(64)));
  const int K8 = (filters + DR - 1) / DR * DR, C8 = (channels + CB - 1) / CB * CB;
  const int group = get_group_id(0) / filters, k = get_group_id(0) - group * filters, c = get_group_id(1) * CB;
  const size_t size = (size_t)groups * taps * K8 * C8;
  for (int begin = 0; begin < taps; begin += 16) {
    const int count = min(16, taps - begin);
    for (int tap = 0; tap < count; tap++) {
      __global const float* from = partial + (((size_t)group * taps + begin + tap) * K8 + k) * C8 + c;
      for (int i = 0; i < CB; i += 16) {
        float16 sum = vload16(0, from + i);
        for (int part = 1; part < parts; part++) sum += vload16(0, from + part * size + i);
        store16(sum, sums + tap * CB + i);
      }
    }
    for (int i = 0; i < min(CB, channels - c); i++)
      for (int tap = 0; tap < count; tap++)
        dw[((size_t)get_group_id(0) * channels + c + i) * taps + begin + tap] = sums[tap * CB + i];
  }
}

// Filters of one channel: for each tap a dot product of rows. Group k: a filter.
FAT __kernel void conv2d_dw_planes(__global const float* restrict x, __global const float* restrict g,
                                   __global float* restrict dw, int N, int C, int H, int W, int K, int P, int Q, int R,
                                   int S, int stride, int pad) {
  const int k = get_group_id(0), channel = k / (K / C);
  const int16 lane = (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  for (int tap = 0; tap < R * S; tap++) {
    const int r = tap / S, s = tap - r * S;
    const int p_hi = last_met(r, stride, pad, P, H), q_lo = first_met(s, stride, pad), q_hi = last_met(s, stride, pad, Q, W);
    float16 sums = (float16)(0.0f);
    float rest = 0.0f;
    for (int n = 0; n < N; n++)
      for (int p = first_met(r, stride, pad); p < p_hi; p++) {
        __global const float* a = g + (((size_t)n * K + k) * P + p) * Q;
        __global const float* b = x + (((size_t)n * C + channel) * H + p * stride + r - pad) * W + s - pad;
        int q = q_lo;
        if (stride == 1 && q_hi - q_lo >= 16) {
          for (; q + 16 <= q_hi; q += 16) sums += vload16(0, a + q) * vload16(0, b + q);
          const int16 fresh = lane >= 16 - (q_hi - q);  // of the last sixteen
          sums += select((float16)(0.0f), vload16(0, a + q_hi - 16) * vload16(0, b + q_hi - 16), fresh);
        } else {
          for (; q < q_hi; q++) rest += a[q] * b[q * stride];
        }
      }
    dw[(size_t)k * R * S + tap] = rest + sum16(sums);
  }
}
