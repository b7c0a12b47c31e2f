// A cube map: images [6,S,S,3] of what is infinitely far, at +x, -x, +y, -y, +z, -z. Bilinear within a face, half-pixel
// centres, border texels go on. version 1.
// taps [3,P]: the texel with the lowest coordinates, face and row and column counted as one number, then how far along
// columns and rows the place lies from it to the next, in units of 2^-30: an integer holds it in float and in double alike.
#define UNIT 1073741824.0f

// The faces' axes: columns run along y of +-x, along x else; rows along z of +-x and +-y, along y else.
__kernel FAT void cube_taps(__global const float* restrict directions, __global const float* restrict turn, __global int* restrict taps,
                            int count, int side, int chunk) {
  const float reach = 0.5f * (float)side, most = (float)(side - 1);
  const int last = max(side - 2, 0);
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    const float a = directions[3 * i], b = directions[3 * i + 1], c = directions[3 * i + 2];
    const float x = turn[0] * a + turn[1] * b + turn[2] * c, y = turn[3] * a + turn[4] * b + turn[5] * c;
    const float z = turn[6] * a + turn[7] * b + turn[8] * c;
    const float ax = fabs(x), ay = fabs(y), az = fabs(z), longest = fmax(fmax(ax, ay), az);
    const int on_x = ax == longest, on_y = !on_x && ay == longest;
    const float way = on_x ? x : on_y ? y : z, across = on_x ? y : x, down = on_x || on_y ? z : y;
    const int face = (on_x ? 0 : on_y ? 2 : 4) + (way < 0.0f ? 1 : 0);
    const float u = clamp((across / longest + 1.0f) * reach - 0.5f, 0.0f, most), v = clamp((down / longest + 1.0f) * reach - 0.5f, 0.0f, most);
    const int column = min((int)u, last), row = min((int)v, last);
    taps[i] = (face * side + row) * side + column;
    taps[count + i] = (int)((u - (float)column) * UNIT);
    taps[2 * count + i] = (int)((v - (float)row) * UNIT);
  }
}

// out [3,P].
__kernel FAT void cube_colours(__global const float* restrict faces, __global const int* restrict taps, __global float* restrict out,
                               int count, int side, int chunk) {
  const int right = side > 1 ? 3 : 0, below = side > 1 ? 3 * side : 0;
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float* a = faces + 3 * (size_t)taps[i];
    const float fx = (float)taps[count + i] / UNIT, fy = (float)taps[2 * count + i] / UNIT;
    for (int c = 0; c < 3; c++) {
      const float up = a[c] * (1.0f - fx) + a[right + c] * fx, down = a[below + c] * (1.0f - fx) + a[below + right + c] * fx;
      out[(size_t)c * count + i] = up * (1.0f - fy) + down * fy;
    }
  }
}

// The gradient. A chunk's pixels by the bands of BAND rows of texels that they touch, within a band in their order: list [2 P]
// has room for the chunk's from 2 * chunk * part on, starts [chunks][bands+1] says where each band's begin. A pixel on the seam
// of two bands is in both.
static inline int bands_of(int row, int* next) {
  *next = (row + 1) / BAND;
  return row / BAND;
}

__kernel FAT void cube_list(__global const int* restrict taps, __global int* restrict starts, __global int* restrict list, int count,
                            int side, int bands, int parts, int chunk) {
  const int part = get_global_id(0);
  if (part >= parts) return;
  __global int* start = starts + (size_t)part * (bands + 1);
  const int begin = part * chunk, end = min(count, begin + chunk), inner = side > 1;
  for (int b = 0; b <= bands; b++) start[b] = 0;
  for (int i = begin; i < end; i++) {
    int next;
    const int band = bands_of(taps[i] / side, &next);
    start[band]++;
    if (inner && next != band) start[next]++;
  }
  int sum = 2 * begin;
  for (int b = 0; b <= bands; b++) {
    const int found = start[b];
    start[b] = sum;
    sum += found;
  }
  for (int i = begin; i < end; i++) {
    int next;
    const int band = bands_of(taps[i] / side, &next);
    list[start[band]++] = i;
    if (inner && next != band) list[start[next]++] = i;
  }
  for (int b = bands; b > 0; b--) start[b] = start[b - 1];  // each had moved on to the next one's beginning
  start[0] = 2 * begin;
}

// g [3,P] -> dfaces [6,S,S,3]: a texel's sum is in the order of the pixels, whatever BAND and chunk.
__kernel FAT void cube_add(__global const int* restrict taps, __global const float* restrict g, __global const int* restrict starts,
                           __global const int* restrict list, __global float* restrict dfaces, int count, int side, int bands, int parts) {
  const int band = get_global_id(0);
  if (band >= bands) return;
  const int low = band * BAND, high = min(6 * side, low + BAND), right = side > 1 ? 3 : 0, below = side > 1 ? 3 * side : 0;
  for (size_t i = (size_t)low * 3 * side; i < (size_t)high * 3 * side; i++) dfaces[i] = 0;
  for (int part = 0; part < parts; part++) {
    __global const int* start = starts + (size_t)part * (bands + 1) + band;
    for (int k = start[0]; k < start[1]; k++) {
      const int i = list[k], texel = taps[i], row = texel / side, next = row + (side > 1);
      const float fx = (float)taps[count + i] / UNIT, fy = (float)taps[2 * count + i] / UNIT;
      __global float* up = dfaces + 3 * (size_t)texel;
      for (int c = 0; c < 3; c++) {
        const float value = g[(size_t)c * count + i];
        if (row >= low) {
          up[c] += (1.0f - fx) * (1.0f - fy) * value;
          up[right + c] += fx * (1.0f - fy) * value;
        }
        if (next < high) {
          up[below + c] += (1.0f - fx) * fy * value;
          up[below + right + c] += fx * fy * value;
        }
      }
    }
  }
}
