// Convolutions of small images for CPU devices: vectors run along the output channels, so that a tap that lies outside
// the image costs nothing (of a 3x3 kernel on 8x8 pixels a sixth of the taps do, on 2x2 pixels more than half).
// Registers hold a line of 8 results x BLOCK output channels. Where there are images enough, a line is one pixel of eight
// images, so that all of it meets the same taps; else eight neighbouring pixels of one image. Weights are packed for
// blocks of output channels: here a few inputs at a time, between two uses; for conv2d_cpu.cl all of them.
//: variant conv2d_lines cpu any BLOCK=32

// The taps of a class, conv2d_cpu.cl.
static inline int first_tap(int pad, int a, int dilation) { return ((pad - a) % dilation + dilation) % dilation; }
static inline int taps_from(int first, int size, int step) { return first < size ? (size - first + step - 1) / step : 0; }

// Where result `o` meets `tap` in the input, or -1.
static inline int place_of(int o, int tap, int stride, int dilation, int pad, int size) {
  const int spread = o * stride + tap - pad, at = dilation == 1 ? spread : spread / dilation;  // divisions are slow
  return spread >= 0 && at * dilation == spread && at < size ? at : -1;
}

// How weights lie: the strides of outputs and inputs, and how many there are; `flip` turns the kernel by 180 degrees: the
// adjoint in x is a convolution with that.
typedef struct {
  int R, S, output_stride, input_stride, size, flip;
} Weights;

// `count` neighbouring weights of BLOCK outputs, outputs innermost, backwards if `flip`. Reads whole vectors of 16.
static inline void turn(__global float* restrict to, __global const float* restrict from, int count, int output_stride,
                        int flip) {
  for (int m = 0; m < BLOCK; m += 16)
    for (int t = 0; t < count; t += 16) {
      float16 r[16];
      UNROLL for (int i = 0; i < 16; i++) {
        r[i] = i < BLOCK ? vload16(0, from + (size_t)(m + i) * output_stride + t) : (float16)(0.0f);
      }
      transpose16(r);
      UNROLL for (int j = 0; j < 16; j++) {
        if (t + j < count) {
          __global float* at = to + (flip ? count - 1 - t - j : t + j) * BLOCK + m;
          if (BLOCK < 16)
            *(__global float8*)at = r[j].lo;
          else
            store16(r[j], at);
        }
      }
    }
}

// The taps r0, r0 + step .. x s0, s0 + step .. of `inputs` inputs and BLOCK outputs, of which `left` are there, from
// w[start] on -> [inputs][taps][BLOCK].
static inline void pack_block(__global float* restrict to, __global const float* restrict w, Weights z, int start, int left,
                              int inputs, int r0, int s0, int step) {
  const int taps = z.R * z.S, run = z.input_stride == taps && !z.flip ? inputs : 1;  // inputs that lie side by side
  for (int i = 0; i < inputs; i += run) {
    const int from = start + i * z.input_stride, count = run * taps;
    if (step == 1 && count > 3 && BLOCK >= 8 && left >= BLOCK &&
        from + (BLOCK - 1) * z.output_stride + count + 16 <= z.size) {
      turn(to, w + from, count, z.output_stride, z.flip);
      to += count * BLOCK;
      continue;
    }
    for (int j = 0; j < run; j++)
      for (int r = r0; r < z.R; r += step)
        for (int s = s0; s < z.S; s += step, to += BLOCK) {
          const int tap = z.flip ? taps - 1 - r * z.S - s : r * z.S + s;
          for (int m = 0; m < BLOCK; m++)
            to[m] = m < left ? w[from + j * z.input_stride + tap + (size_t)m * z.output_stride] : 0.0f;
        }
  }
}

// Weights -> [group][ceil(outputs / BLOCK)][class][inputs][taps of the class][BLOCK], zeros beyond the last output; the
// classes of conv2d_cpu.cl. Group (b, i): block b of all groups, chunk i of the inputs.
FAT __kernel void pack_weights(__global const float* restrict w, __global float* restrict packed, int outputs,
                               int inputs, int R, int S, int output_stride, int input_stride, int size, int flip,
                               int dilation, int pad_y, int pad_x, int chunk) {
  const Weights z = {R, S, output_stride, input_stride, size, flip};
  const int blocks = (outputs + BLOCK - 1) / BLOCK, group = get_group_id(0) / blocks;
  const int first = (get_group_id(0) - group * blocks) * BLOCK;
  const int begin = get_group_id(1) * chunk, end = min(inputs, begin + chunk);
  const int start = group * inputs * outputs * R * S + first * output_stride + begin * input_stride;
  packed += (size_t)get_group_id(0) * inputs * R * S * BLOCK;
  for (int class = 0; class < dilation * dilation; class++) {
    const int r0 = first_tap(pad_y, class / dilation, dilation), s0 = first_tap(pad_x, class % dilation, dilation);
    const int taps = taps_from(r0, R, dilation) * taps_from(s0, S, dilation);
    pack_block(packed + (size_t)begin * taps * BLOCK, w, z, start, outputs - first, end - begin, r0, s0, dilation);
    packed += (size_t)inputs * taps * BLOCK;
  }
}

#if BLOCK >= 16
// x [images,channels,pixels] -> [ceil(images / 8)][channels][pixels][8 images]. Group (n, c): eight images, chunk c of
// the channels.
FAT __kernel void pack_images(__global const float* restrict x, __global float* restrict lines, int images,
                              int channels, int pixels, int chunk) {
  const int first = get_group_id(0) * 8, count = min(8, images - first);
  const int begin = get_group_id(1) * chunk, end = min(channels, begin + chunk);
  lines += (size_t)get_group_id(0) * channels * pixels * 8;
  for (int c = begin; c < end; c++)
    for (int lane = 0; lane < 8; lane++) {
      __global const float* from = x + ((size_t)(first + min(lane, count - 1)) * channels + c) * pixels;
      __global float* to = lines + (size_t)c * pixels * 8 + lane;
      for (int p = 0; p < pixels; p++) to[p * 8] = lane < count ? from[p] : 0.0f;
    }
}

// x [images,channels,H,W] -> [images][line][channels][R * S][8]: what eight neighbouring results meet at each tap, zero
// outside the image. Group (l, c): a line, chunk c of the channels.
FAT __kernel void pack_pixels(__global const float* restrict x, __global float* restrict lines, int images,
                              int channels, int H, int W, int out_height, int out_width, int R, int S, int stride,
                              int dilation, int pad_y, int pad_x, int chunk) {
  __local int places[8 * MAX_TAPS], shifts[MAX_TAPS];
  const int per_image = (out_height * out_width + 7) / 8, image = get_group_id(0) / per_image;
  const int line = get_group_id(0) - image * per_image, taps = R * S;
  const int begin = get_group_id(1) * chunk, end = min(channels, begin + chunk);
  const int y0 = line * 8 / out_width, x0 = line * 8 - y0 * out_width;
  for (int t = 0; t < taps; t++) {
    int shift = 0, found = 0, apart = 0;  // apart: the eight do not lie side by side
    for (int lane = 0, y = y0, x = x0; lane < 8; lane++) {
      const int row = y < out_height ? place_of(y, t / S, stride, dilation, pad_y, H) : -1;
      const int column = place_of(x, t % S, stride, dilation, pad_x, W);
      const int place = row < 0 || column < 0 ? -1 : row * W + column;
      if (place >= 0) apart |= found && place - lane != shift, shift = place - lane, found = 1;
      places[t * 8 + lane] = place;
      if (++x == out_width) x = 0, y++;
    }
    shifts[t] = apart ? INT_MIN : shift;
  }
  lines += (size_t)get_group_id(0) * channels * taps * 8;
  for (int c = begin; c < end; c++)
    for (int t = 0; t < taps; t++) {
      const long from = ((long)image * channels + c) * H * W, at = from + shifts[t];
      __global float* to = lines + ((size_t)c * taps + t) * 8;
      if (at >= 0 && at + 8 <= (long)images * channels * H * W && shifts[t] != INT_MIN) {
        *(__global float8*)to = select(vload8(0, x + at), (float8)(0.0f), vload8(t, places) < 0);
      } else {
        for (int lane = 0; lane < 8; lane++) {
          const int place = places[t * 8 + lane];
          to[lane] = place < 0 ? 0.0f : x[from + place];
        }
      }
    }
}

// The taps that any result of the line meets: where their inputs lie within a channel (pixels where a line is one of them,
// `by_image`, else what pack_pixels wrote for the tap), which weights they take.
static inline int list_taps(__local int* restrict places, __local int* restrict weights, int first, int results, int by_image,
                            int H, int W, int out_width, int R, int S, int stride, int dilation, int pad_y, int pad_x) {
  const int y0 = first / out_width, x0 = first - y0 * out_width;
  int count = 0;
  for (int t = 0; t < R * S; t++) {
    int place = -1;
    for (int i = 0, y = y0, x = x0; i < results; i++) {
      const int row = place_of(y, t / S, stride, dilation, pad_y, H);
      const int column = place_of(x, t % S, stride, dilation, pad_x, W);
      if (row >= 0 && column >= 0) place = by_image ? row * W + column : t;
      if (++x == out_width) x = 0, y++;
    }
    if (place >= 0) places[count] = place * 8, weights[count++] = t * BLOCK;
  }
  return count;
}

#define NV (BLOCK / 16)
static inline void micro_line(__local float* restrict sums, __global const float* restrict x, __global const float* restrict w,
                              __local const int* restrict places, __local const int* restrict weights, int taps, int inputs,
                              int x_step, int w_step, int add) {
  float16 acc[8][NV];
  UNROLL for (int i = 0; i < 8; i++) UNROLL for (int v = 0; v < NV; v++) {
    acc[i][v] = add ? vload16(i * NV + v, sums) : (float16)(0.0f);
  }
  for (int c = 0; c < inputs; c++, x += x_step, w += w_step)
    for (int t = 0; t < taps; t++) {
      float16 weight[NV];
      UNROLL for (int v = 0; v < NV; v++) weight[v] = vload16(v, w + weights[t]);
      UNROLL for (int i = 0; i < 8; i++) {
        const float16 value = (float16)(x[places[t] + i]);
        UNROLL for (int v = 0; v < NV; v++) acc[i][v] += value * weight[v];
      }
    }
  UNROLL for (int i = 0; i < 8; i++) UNROLL for (int v = 0; v < NV; v++) store16(acc[i][v], sums + (i * NV + v) * 16);
}

// Group (l, b): `chunk` lines from l * chunk on, block b of all groups' blocks of outputs. `scratch` has room for the
// packed weights of `depth` inputs for each.
FAT __kernel void conv2d_lines(__global const float* restrict lines, __global const float* restrict w,
                               __global float* restrict scratch, __global float* restrict out,
                               __global const float* restrict bias, __global const float* restrict residual, int images,
                               int inputs, int in_height, int in_width, int outputs, int out_height, int out_width,
                               int R, int S, int stride, int dilation, int pad_y, int pad_x, int groups,
                               int output_stride, int input_stride, int size, int flip, int by_image, int line_count,
                               int chunk, int depth, int bias_step, int epilogue) {
  __local int places[LINES * MAX_TAPS], weights[LINES * MAX_TAPS], taps[LINES];
  __local float sums[LINES * 8 * BLOCK] __attribute__((aligned(64)));
  const Weights z = {R, S, output_stride, input_stride, size, flip};
  const int blocks = (outputs + BLOCK - 1) / BLOCK, group = get_group_id(1) / blocks;
  const int first = (get_group_id(1) - group * blocks) * BLOCK, count = min(BLOCK, outputs - first);
  const int results = out_height * out_width, per_image = by_image ? results : (results + 7) / 8;
  const int channel = (by_image ? in_height * in_width : R * S) * 8;
  const int first_line = get_group_id(0) * chunk, here = min(chunk, line_count - first_line);
  scratch += (get_group_id(0) * get_num_groups(1) + get_group_id(1)) * depth * R * S * BLOCK;
  for (int l = 0; l < here; l++) {
    const int line = first_line + l, pixel = line % per_image * (by_image ? 1 : 8);
    taps[l] = list_taps(places + l * MAX_TAPS, weights + l * MAX_TAPS, pixel, by_image ? 1 : min(8, results - pixel),
                        by_image, in_height, in_width, out_width, R, S, stride, dilation, pad_y, pad_x);
  }
  for (int c = 0; c < inputs; c += depth) {
    pack_block(scratch, w, z, group * inputs * outputs * R * S + first * output_stride + c * input_stride, count,
               min(depth, inputs - c), 0, 0, 1);
    for (int l = 0; l < here; l++) {
      const size_t line = by_image ? (first_line + l) / per_image : first_line + l;
      micro_line(sums + l * 8 * BLOCK, lines + ((line * groups + group) * inputs + c) * channel, scratch,
                 places + l * MAX_TAPS, weights + l * MAX_TAPS, taps[l], min(depth, inputs - c), channel, R * S * BLOCK,
                 c > 0);
    }
  }
  for (int l = 0; l < here; l++) {
    const int n = (first_line + l) / per_image, pixel = (first_line + l - n * per_image) * (by_image ? 1 : 8);
    const int lanes = by_image ? min(8, images - n * 8) : min(8, results - pixel);
    for (int i = 0; i < lanes; i++) {
      const size_t image = by_image ? n * 8 + i : n;
      const size_t at = ((image * groups + group) * outputs + first) * results + pixel + (by_image ? 0 : i);
      __local float* sum = sums + (l * 8 + i) * BLOCK;
      if (epilogue & EPILOGUE_BIAS)
        for (int k = 0; k < count; k++) sum[k] += bias[image * bias_step + group * outputs + first + k];
      if (epilogue & EPILOGUE_RESIDUAL)
        for (int k = 0; k < count; k++) sum[k] += residual[at + (size_t)k * results];
      for (int k = 0; k < BLOCK; k += 16) store16(activate16(vload16(0, sum + k), epilogue), sum + k);
      for (int k = 0; k < count; k++) out[at + (size_t)k * results] = sum[k];
    }
  }
}
#endif
