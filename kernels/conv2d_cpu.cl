// Convolution and its adjoint in x for CPU devices: a work-item computes a tile of the result from a tile of the input
// that it has packed, with its halo and zeros for padding, into local memory (scratch of one core). Registers hold MR
// output channels x NVY rows x NVX vectors of 16 pixels. No im2col: a tap of the kernel is an offset into the tile.
//
// Both passes are one formula: `in` spread `dilation` apart, then convolved at `stride` (one of the two is 1).
//   out[k, y, x] = sum over c, r, s of spread[c, y * stride + r - pad_y, x * stride + s - pad_x] * w[k, c, r, s]
// A result at y = dilation * i + a meets taps r = (pad_y - a) mod dilation, + dilation, .. only: each of the dilation^2
// classes (a, b) of results is a plain convolution with some of the taps, over the same tile.
//: variant conv2d_rows cpu wide MR=8 NVX=2 NVY=1
//: variant conv2d_rows cpu narrow MR=8 NVX=1 NVY=2
//: variant conv2d_rows cpu few MR=4 NVX=2 NVY=2
//: variant conv2d_rows cpu one MR=1 NVX=2 NVY=4
#define NV (NVX * NVY)

static inline int modulo_of(int a, int n) { return (a % n + n) % n; }
static inline int ceil_div(int a, int n) { return (a + n - 1 + (a < 0 ? 1 - n : 0)) / n; }
static inline int taps_of(int size, int first, int step) { return first < size ? (size - first + step - 1) / step : 0; }

static inline void copy_floats(__local float* restrict to, __global const float* restrict from, int count) {
  int q = 0;
  for (; q + 16 <= count; q += 16) store16(vload16(0, from + q), to + q);
  if (q == count) return;
  if (count >= 16)
    store16(vload16(0, from + count - 16), to + count - 16);  // the rest, some of it again
  else
    for (; q < count; q++) to[q] = from[q];
}

// Element t of a row of the input tile goes to phase t % stride, place t / stride, so that neighbouring results read
// neighbouring floats: places [low, high) of `used` lie inside the image, from begin + low * stride on.
typedef struct {
  int begin, stride, low, high, used;
} Phase;

static inline void pack_row(__local float* restrict to, __global const float* restrict row, Phase p) {
  const float16 zero = (float16)(0.0f);
  for (int q = 0; q < p.low; q += 16) store16(zero, to + q);
  for (int q = p.high & ~15; q < p.used; q += 16) store16(zero, to + q);
  if (p.stride == 1)
    copy_floats(to + p.low, row + p.begin + p.low, p.high - p.low);
  else
    for (int q = p.low; q < p.high; q++) to[q] = row[p.begin + q * p.stride];
}

// `height` rows of each of `channels` planes, from row y0 and column x0 on; what lies outside the image is zero.
static inline void pack_tile(__local float* restrict tile, __global const float* restrict in, int channels, int in_height,
                             int in_width, int y0, int x0, int height, int stride, int places, int used) {
  const int y_low = clamp(-y0, 0, height), y_high = clamp(in_height - y0, y_low, height), pitch = stride * places;
  const size_t plane = (size_t)in_height * in_width;
  for (int phase = 0; phase < stride; phase++) {
    const int begin = x0 + phase, low = begin < 0 ? min(used, (-begin + stride - 1) / stride) : 0;
    const Phase p = {begin, stride, low, clamp((in_width - begin + stride - 1) / stride, low, used), used};
    for (int c = 0; c < channels; c++) {
      __local float* to = tile + c * height * pitch + phase * places;
      __global const float* row = in + c * plane + (long)(y0 + y_low) * in_width;
      for (int h = 0; h < y_low; h++)
        for (int q = 0; q < places; q += 16) store16((float16)(0.0f), to + h * pitch + q);
      for (int h = y_low; h < y_high; h++, row += in_width) {
        if (c + 1 < channels)
          for (int q = p.low * stride; q < p.high * stride; q += 16)
            __builtin_prefetch(row + plane + begin + q);
        pack_row(to + h * pitch, row, p);
      }
      for (int h = y_high; h < height; h++)
        for (int q = 0; q < places; q += 16) store16((float16)(0.0f), to + h * pitch + q);
    }
  }
}

static inline void micro_tile(__local const float* restrict tile, __local const int* restrict taps,
                              __global const float* restrict w, int count, int row_step, float16 acc[MR][NV]) {
  UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) acc[i][v] = (float16)(0.0f);
#pragma unroll 2
  for (int t = 0; t < count; t++) {
    __local const float* from = tile + taps[t];
    float16 pixels[NV];
    UNROLL for (int v = 0; v < NV; v++) pixels[v] = vload16(0, from + (v / NVX) * row_step + (v % NVX) * 16);
    UNROLL for (int i = 0; i < MR; i++) {
      const float16 weight = (float16)(w[t * MR + i]);
      UNROLL for (int v = 0; v < NV; v++) acc[i][v] += weight * pixels[v];
    }
  }
}

// Group (t, b, n): tile t of tile_rows x tile_columns results of a class; b = group * blocks + block of block_outputs
// channels; image n. `places` floats hold one phase of a row of which `used` are read, tile_height rows are packed,
// `depth` input channels at a time. bias_step: numbers between the biases of two images.
FAT __kernel void conv2d_rows(__global const float* restrict in, __global const float* restrict packed,
                              __global float* restrict out, __global const float* restrict bias,
                              __global const float* restrict residual, int inputs, int in_height, int in_width,
                              int outputs, int out_height, int out_width, int R, int S, int stride, int dilation,
                              int pad_y, int pad_x, int tile_rows, int tile_columns, int tile_height, int places,
                              int used, int depth, int block_outputs, int groups, int bias_step, int epilogue) {
  __local float tile[TILE] __attribute__((aligned(64)));
  __local int taps[TAPS];
  __local float edge[MR * NV * 16] __attribute__((aligned(64)));
  const int across = (ceil_div(out_width, dilation) + tile_columns - 1) / tile_columns;
  const int ty = get_group_id(0) / across, tx = get_group_id(0) - ty * across;
  const int blocks = (outputs + block_outputs - 1) / block_outputs;
  const int group = get_group_id(1) / blocks, first = (get_group_id(1) - group * blocks) * block_outputs;
  const int y0 = ty * tile_rows, x0 = tx * tile_columns;
  const int last = min(outputs, first + block_outputs), pitch = stride * places, plane = tile_height * pitch;
  const size_t image = get_group_id(2), out_plane = (size_t)out_height * out_width;
  // The input row and column of the tile's first element.
  const int in_y = y0 * stride + ceil_div(-pad_y, dilation), in_x = x0 * stride + ceil_div(-pad_x, dilation);
  in += (image * groups + group) * inputs * in_height * in_width;
  out += (image * groups + group) * outputs * out_plane;
  residual += epilogue & EPILOGUE_RESIDUAL ? (image * groups + group) * outputs * out_plane : 0;
  bias += epilogue & EPILOGUE_BIAS ? image * bias_step + group * outputs : 0;
  packed += (size_t)group * ((outputs + MR - 1) / MR) * inputs * R * S * MR;

  for (int c0 = 0; c0 < inputs; c0 += depth) {
    const int channels = min(depth, inputs - c0), finished = c0 + depth >= inputs ? epilogue : 0;
    pack_tile(tile, in + (size_t)c0 * in_height * in_width, channels, in_height, in_width, in_y, in_x, tile_height,
              stride, places, used);
    int taps_before = 0;
    for (int class = 0; class < dilation * dilation; class++) {
      const int a = class / dilation, b = class - a * dilation;
      const int r0 = modulo_of(pad_y - a, dilation), s0 = modulo_of(pad_x - b, dilation);
      const int down = (a + r0 - pad_y) / dilation - ceil_div(-pad_y, dilation);
      const int right = (b + s0 - pad_x) / dilation - ceil_div(-pad_x, dilation);
      const int class_taps = taps_of(R, r0, dilation) * taps_of(S, s0, dilation);
      const int y_end = min(tile_rows, taps_of(out_height, a, dilation) - y0);
      const int x_end = min(tile_columns, taps_of(out_width, b, dilation) - x0);
      int count = 0;
      for (int c = 0; c < channels; c++)
        for (int r = r0, h = down; r < R; r += dilation, h++)
          for (int s = s0, q = right; s < S; s += dilation, q++)
            taps[count++] = c * plane + h * pitch + (q % stride) * places + q / stride;
      for (int co = first; co < last; co += MR)
        for (int y = 0; y < y_end; y += NVY)
          for (int x = 0; x < x_end; x += NVX * 16) {
            float16 acc[MR][NV];
            micro_tile(tile + y * stride * pitch + x, taps,
                       packed + ((size_t)(co / MR) * R * S * inputs + taps_before * inputs + c0 * class_taps) * MR,
                       count, stride * pitch, acc);
            const size_t at =
                co * out_plane + (size_t)((y0 + y) * dilation + a) * out_width + (x0 + x) * dilation + b;
            if (dilation == 1 && x + NVX * 16 <= x_end) {
              UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++) {
                if (co + i < last && y + v / NVX < y_end) {
                  const size_t to = at + i * out_plane + (size_t)(v / NVX) * out_width + (v % NVX) * 16;
                  if (c0 > 0) acc[i][v] += vload16(0, out + to);
                  if (finished & EPILOGUE_BIAS) acc[i][v] += bias[co + i];
                  if (finished & EPILOGUE_RESIDUAL) acc[i][v] += vload16(0, residual + to);
                  if (finished & ~(EPILOGUE_BIAS | EPILOGUE_RESIDUAL)) acc[i][v] = activate16(acc[i][v], finished);
                  store16(acc[i][v], out + to);
                }
              }
            } else {
              UNROLL for (int i = 0; i < MR; i++) UNROLL for (int v = 0; v < NV; v++)
                  vstore16(acc[i][v], i * NV + v, edge);
              for (int i = 0; i < min(MR, last - co); i++)
                for (int j = 0; j < min(NVY, y_end - y); j++)
                  for (int q = 0; q < min(NVX * 16, x_end - x); q++) {
                    const size_t to = at + i * out_plane + (size_t)j * dilation * out_width + q * dilation;
                    float sum = edge[(i * NVY + j) * (NVX * 16) + q] + (c0 > 0 ? out[to] : 0.0f);
                    if (finished & EPILOGUE_BIAS) sum += bias[co + i];
                    if (finished & EPILOGUE_RESIDUAL) sum += residual[to];
                    out[to] = activate(sum, finished);
                  }
            }
          }
      taps_before += class_taps;
    }
  }
}
