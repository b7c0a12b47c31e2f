// Gradient of a convolution's weights for CPU devices: a matrix product with pixels as the depth, of the result's
// gradient and the input, whose tile is packed with channels innermost.
//: variant conv2d_dw_tiles cpu wide CB=64 DR=8
//: variant conv2d_dw_tiles cpu half CB=32 DR=8
//: variant conv2d_dw_tiles cpu narrow CB=16 DR=8
// Input tile -> [height][width][CB], channels innermost, zeros outside the image and beyond the last channel.
inline void pack_pixels(__local float* restrict to, __global const float* restrict x, int channels, int H, int W,
                        int y0, int x0, int height, int width) {
  for (int h = 0; h < height; h++)
    for (int q = 0; q < width; q += 16)
      for (int c = 0; c < CB; c += 16) {
        const int y = y0 + h, column = x0 + q;
        float16 r[16];
        UNROLL for (int i = 0; i < 16; i++) r[i] = (float16)(0.0f);
        if (y >= 0 && y < H && c < channels) {
          __global const float* from = x + ((size_t)c * H + y) * W + column;
          if (column >= 0 && column + 16 <= W && c + 16 <= channels) {
            UNROLL for (int i = 0; i < 16; i++) r[i] = vload16(0, from + (size_t)i * H * W);
          } else {
            float some[256];
            for (int i = 0; i < 16; i++)
              for (int j = 0; j < 16; j++)
                some[i * 16 + j] =
                    c + i < channels && column + j >= 0 && column + j < W ? from[(size_t)i * H * W + j] : 0.0f;
            UNROLL for (int i = 0; i < 16; i++) r[i] = vload16(i, some);
          }
        }
        transpose16(r);
        UNROLL for (int i = 0; i < 16; i++)
          if (q + i < width) vstore16(r[i], 0, to + ((size_t)h * width + q + i) * CB + c);
      }
}

// Group (p, b): part p of `parts` adds up tiles p, p + parts, .. of all images into its own
// partial [R * S][K8][C8] (per group; K8, C8: rounded up to DR and CB), for the b-th (group, DR * DB filters, CB
// channels). conv2d_dw_sum joins the parts. A matrix product with pixels as the depth: DR filters x CB channels in
// registers at a time.
#define DV (CB < 32 ? 1 : 2)
FAT __kernel void conv2d_dw_tiles(__global const float* restrict x, __global const float* restrict g,
                                  __global float* restrict partial, int N, int channels, int H, int W, int filters,
                                  int P, int Q, int R, int S, int stride, int pad, int tile_rows, int tile_columns,
                                  int block_filters, int groups, int parts) {
  __local float pixels[TILE] __attribute__((aligned(64)));
  __local float rows[DR * GROW] __attribute__((aligned(64)));
  const int k_blocks = (filters + block_filters - 1) / block_filters, c_blocks = (channels + CB - 1) / CB;
  const int group = get_group_id(1) / (k_blocks * c_blocks), rest = get_group_id(1) - group * k_blocks * c_blocks;
  const int k_first = rest / c_blocks * block_filters, c_first = (rest % c_blocks) * CB;
  const int k_last = min(filters, k_first + block_filters), width = (tile_columns - 1) * stride + S;
  const int across = (Q + tile_columns - 1) / tile_columns, down = (P + tile_rows - 1) / tile_rows;
  const int K8 = (filters + DR - 1) / DR * DR, C8 = c_blocks * CB, pitch = tile_rows * tile_columns;
  partial += ((size_t)get_group_id(0) * groups + group) * R * S * K8 * C8;

  for (int t = get_group_id(0); t < across * down * N; t += parts) {
    const int n = t / (across * down), ty = (t - n * across * down) / across, tx = t % across;
    const int p0 = ty * tile_rows, q0 = tx * tile_columns, p_end = min(tile_rows, P - p0),
              q_end = min(tile_columns, Q - q0);
    pack_pixels(pixels, x + (((size_t)n * groups + group) * channels + c_first) * H * W, min(CB, channels - c_first), H,
                W, p0 * stride - pad, q0 * stride - pad, (p_end - 1) * stride + R, width);
    for (int k = k_first; k < k_last; k += DR) {
      for (int i = 0; i < DR; i++)
        for (int p = 0; p < p_end; p++) {
          __global const float* from =
              g + ((((size_t)n * groups + group) * filters + min(k + i, filters - 1)) * P + p0 + p) * Q + q0;
          for (int q = 0; q < q_end; q++) rows[i * pitch + p * tile_columns + q] = from[q];
        }
      for (int tap = 0; tap < R * S; tap++)
        for (int c = 0; c < CB; c += DV * 16) {
          __global float* to = partial + ((size_t)tap * K8 + k) * C8 + c_first + c;
          float16 acc[DR][DV];
          UNROLL for (int i = 0; i < DR; i++) UNROLL for (int v = 0; v < DV; v++) {
            acc[i][v] = t < parts ? (float16)(0.0f) : vload16(v, to + (size_t)i * C8);
          }
          for (int p = 0; p < p_end; p++) {
            __local const float* b = pixels + ((size_t)(p * stride + tap / S) * width + tap % S) * CB + c;
            __local const float* a = rows + p * tile_columns;
#pragma unroll 2
            for (int q = 0; q < q_end; q++) {
              float16 value[DV];
              UNROLL for (int v = 0; v < DV; v++) value[v] = vload16(v, b + q * stride * CB);
              UNROLL for (int i = 0; i < DR; i++) {
                const float16 d = (float16)(a[i * pitch + q]);
                UNROLL for (int v = 0; v < DV; v++) acc[i][v] += d * value[v];
              }
            }
          }
          UNROLL for (int i = 0; i < DR; i++) UNROLL for (int v = 0; v < DV; v++)
              vstore16(acc[i][v], v, to + (size_t)i * C8);
        }
    }
  }
}

// dw[k][c][tap] = sum over parts, in order, of partial[part][group][tap][k][c]. Group (k, c): a filter, CB channels.
// Through local memory, so that both sides are walked along their lines.
#define TAPS_AT_ONCE 32
FAT __kernel void conv2d_dw_sum(__global const float* restrict partial, __global float* restrict dw, int channels,
                                int filters, int taps, int groups, int parts) {
  __local float sums[TAPS_AT_ONCE * CB] __attribute__((aligned(64)));
  const int K8 = (filters + DR - 1) / DR * DR, C8 = (channels + CB - 1) / CB * CB;
  const int group = get_group_id(0) / filters, k = get_group_id(0) - group * filters, c = get_group_id(1) * CB;
  const size_t size = (size_t)groups * taps * K8 * C8;
  for (int begin = 0; begin < taps; begin += TAPS_AT_ONCE) {
    const int count = min(TAPS_AT_ONCE, taps - begin);
    for (int tap = 0; tap < count; tap++) {
      __global const float* from = partial + (((size_t)group * taps + begin + tap) * K8 + k) * C8 + c;
      for (int i = 0; i < CB; i += 16) {
        float16 sum = vload16(0, from + i);
        for (int part = 1; part < parts; part++) sum += vload16(0, from + part * size + i);
        vstore16(sum, 0, sums + tap * CB + i);
      }
    }
    for (int i = 0; i < min(CB, channels - c); i++)
      for (int tap = 0; tap < count; tap++)
        dw[((size_t)get_group_id(0) * channels + c + i) * taps + begin + tap] = sums[tap * CB + i];
  }
}
