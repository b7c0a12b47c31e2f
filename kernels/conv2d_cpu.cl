// Version 2 of conv2d.cl, for CPU devices: a work-item computes a tile of the result from a tile of the input that it
// has packed, with its halo and zeros for padding, into local memory (scratch of one core). Registers hold MR output
// channels x NVY rows x NVX vectors of VW pixels. No im2col: a tap of the kernel is an offset into the tile.
#define JOIN2(a, b) a##b
#define JOIN(a, b) JOIN2(a, b)
#define VECTOR JOIN(float, VW)
#define LOAD JOIN(vload, VW)
#define STORE JOIN(vstore, VW)
#define NV (NVX * NVY)

// Weights -> [group][ceil(outputs / MR)][inputs][taps][MR], zeros beyond the last output. The strides tell where the
// weight of (group, output, input) lies; `flip` turns the kernel by 180 degrees: the adjoint in x is a convolution with
// that.
FAT __kernel void pack_weights(__global const float* restrict w, __global float* restrict packed, int outputs,
                               int inputs, int taps, int group_stride, int output_stride, int input_stride, int flip,
                               int chunk) {
  const int blocks = (outputs + MR - 1) / MR, group = get_group_id(0) / blocks,
            block = get_group_id(0) - group * blocks;
  const int left = outputs - block * MR, step = flip ? -1 : 1;
  const int begin = get_group_id(1) * chunk, end = min(inputs, begin + chunk);
  w += (size_t)group * group_stride + (size_t)block * MR * output_stride + (flip ? taps - 1 : 0);
  packed += (size_t)get_group_id(0) * inputs * taps * MR;
  for (int i = begin; i < end; i++)
    for (int t = 0; t < taps; t++) {
      __global const float* from = w + (size_t)i * input_stride + t * step;
      __global float* to = packed + ((size_t)i * taps + t) * MR;
      if (left >= MR) {
        UNROLL for (int m = 0; m < MR; m++) to[m] = from[(size_t)m * output_stride];
      } else {
        for (int m = 0; m < MR; m++) to[m] = m < left ? from[(size_t)m * output_stride] : 0.0f;
      }
    }
}

// One row of the input tile: element t of the (dilated, padded) row goes to phase t % stride, place t / stride, so that
// neighbouring results read neighbouring floats. `first` is the input column of t = 0; only one of stride, dilation is
// not 1.
inline void pack_row(__local float* restrict to, __global const float* restrict row, int width, int first, int stride,
                     int dilation, int places) {
  if (dilation > 1) {
    for (int t = 0; t < places; t++) to[t] = 0.0f;
    for (int x = max(0, (first + dilation - 1) / dilation); x < width && x * dilation - first < places; x++)
      to[x * dilation - first] = row[x];
    return;
  }
  for (int phase = 0; phase < stride; phase++, to += places) {
    const int begin = first + phase;
    const int low = begin < 0 ? min(places, (-begin + stride - 1) / stride) : 0;
    const int high = clamp((width - begin + stride - 1) / stride, low, places);
    int q = 0;
    for (; q < low; q++) to[q] = 0.0f;
    if (stride == 1) {
      for (; q + 8 <= high; q += 8) vstore8(vload8(0, row + begin + q), 0, to + q);
      for (; q < high; q++) to[q] = row[begin + q];
    } else {
      for (; q < high; q++) to[q] = row[begin + q * stride];
    }
    for (; q < places; q++) to[q] = 0.0f;
  }
}

inline void micro_tile(__local const float* restrict tile, __local const int* restrict taps,
                       __global const float* restrict w, int count, int row_step, VECTOR acc[MR][NV]) {
  UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = (VECTOR)(0.0f);
#pragma unroll 2
  for (int t = 0; t < count; t++) {
    __local const float* from = tile + taps[t];
    VECTOR pixels[NV];
    UNROLL for (int v = 0; v < NV; v++) pixels[v] = LOAD(0, from + (v / NVX) * row_step + (v % NVX) * VW);
    UNROLL for (int i = 0; i < MR; i++) {
      const VECTOR weight = (VECTOR)(w[t * MR + i]);
      UNROLL for (int v = 0; v < NV; v++) acc[i][v] += weight * pixels[v];
    }
  }
}

// out[n, co, y, x] = sum of in[n, ci, y * stride + r - pad_y, ...] * packed weights, where `in` is spread `dilation`
// apart. Group (t, b, n): tile t of tile_rows x tile_columns; b = group * blocks + block of block_outputs channels;
// image n. `places` floats hold one phase of a row, tile_height rows are packed, `depth` input channels at a time.
FAT __kernel void conv2d_tiles(__global const float* restrict in, __global const float* restrict packed,
                               __global float* restrict out, int inputs, int in_height, int in_width, int outputs,
                               int out_height, int out_width, int R, int S, int stride, int dilation, int pad_y,
                               int pad_x, int tile_rows, int tile_columns, int tile_height, int places, int depth,
                               int block_outputs, int groups) {
  __local float tile[TILE] __attribute__((aligned(64)));
  __local int taps[TAPS];
  __local float edge[MR * NV * VW] __attribute__((aligned(64)));
  const int across = (out_width + tile_columns - 1) / tile_columns;
  const int ty = get_group_id(0) / across, tx = get_group_id(0) - ty * across;
  const int blocks = (outputs + block_outputs - 1) / block_outputs;
  const int group = get_group_id(1) / blocks, first = (get_group_id(1) - group * blocks) * block_outputs;
  const int y0 = ty * tile_rows, x0 = tx * tile_columns;
  const int y_end = min(tile_rows, out_height - y0), x_end = min(tile_columns, out_width - x0);
  const int last = min(outputs, first + block_outputs), pitch = stride * places, plane = tile_height * pitch;
  const size_t image = get_group_id(2), out_plane = (size_t)out_height * out_width;
  in += (image * groups + group) * inputs * in_height * in_width;
  out += (image * groups + group) * outputs * out_plane + (size_t)y0 * out_width + x0;
  packed += (size_t)group * ((outputs + MR - 1) / MR) * inputs * R * S * MR;
  int count = 0;
  for (int c = 0; c < min(depth, inputs); c++)
    for (int r = 0; r < R; r++)
      for (int s = 0; s < S; s++) taps[count++] = c * plane + r * pitch + (s % stride) * places + s / stride;

  for (int c0 = 0; c0 < inputs; c0 += depth) {
    const int channels = min(depth, inputs - c0);
    for (int c = 0; c < channels; c++)
      for (int h = 0; h < tile_height; h++) {
        const int spread = y0 * stride + h - pad_y, y = spread / dilation;
        __local float* to = tile + c * plane + h * pitch;
        if (spread < 0 || y * dilation != spread || y >= in_height) {
          for (int q = 0; q < pitch; q++) to[q] = 0.0f;
        } else {
          pack_row(to, in + ((size_t)(c0 + c) * in_height + y) * in_width, in_width, x0 * stride - pad_x, stride,
                   dilation, places);
        }
      }
    for (int y = 0; y < y_end; y += NVY)
      for (int x = 0; x < x_end; x += NVX * VW)
        for (int co = first; co < last; co += MR) {
          VECTOR acc[MR][NV];
          micro_tile(tile + y * stride * pitch + x, taps, packed + ((size_t)(co / MR) * inputs + c0) * R * S * MR,
                     channels * R * S, stride * pitch, acc);
          __global float* to = out + co * out_plane + (size_t)y * out_width + x;
          if (co + MR <= last && y + NVY <= y_end && x + NVX * VW <= x_end) {
            UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) {
              __global float* at = to + i * out_plane + (size_t)(v / NVX) * out_width + (v % NVX) * VW;
              if (c0 > 0) acc[i][v] += LOAD(0, at);
              STORE(acc[i][v], 0, at);
            }
          } else {
            UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) STORE(acc[i][v], i * NV + v, edge);
            for (int i = 0; i < min(MR, last - co); i++)
              for (int j = 0; j < min(NVY, y_end - y); j++)
                for (int q = 0; q < min(NVX * VW, x_end - x); q++) {
                  __global float* at = to + i * out_plane + (size_t)j * out_width + q;
                  *at = edge[(i * NVY + j) * (NVX * VW) + q] + (c0 > 0 ? *at : 0.0f);
                }
          }
        }
  }
}

inline void transpose16(float16 r[16]) {
  float16 t[16];
  UNROLL for (int stage = 0; stage < 4; stage++) {  // four perfect shuffles of rows make a transpose
    UNROLL for (int i = 0; i < 8; i++) {
      const float16 p = r[i], q = r[i + 8];
      t[2 * i] =
          (float16)(p.s0, q.s0, p.s1, q.s1, p.s2, q.s2, p.s3, q.s3, p.s4, q.s4, p.s5, q.s5, p.s6, q.s6, p.s7, q.s7);
      t[2 * i + 1] =
          (float16)(p.s8, q.s8, p.s9, q.s9, p.sa, q.sa, p.sb, q.sb, p.sc, q.sc, p.sd, q.sd, p.se, q.se, p.sf, q.sf);
    }
    UNROLL for (int i = 0; i < 16; i++) r[i] = t[i];
  }
}

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

// Gradient of the weights. Group (p, b): part p of `parts` adds up tiles p, p + parts, .. of all images into its own
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
