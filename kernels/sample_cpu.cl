// Bilinear sampling on CPU devices, for LANES * VECTORS channels: rows of texels are whole vectors, and what a block of
// samples will touch is asked for before it is computed with. The plain form and the layouts are in kernels/sample.cl.
// Gradient: samples are listed by bands of BAND rows, small enough for a core's cache, and a work-item adds up an image's
// band in the order of samples. A sample on the seam of two bands is in both lists, so a texel's sum has one order
// whatever BAND and the number of work-items are.
//: variant sample_vectors cpu vectors BAND=32
//: variant sample_vectors cpu vectors BAND=64
//: variant sample_vectors cpu vectors BAND=128
#define BLOCK 16
#define CHANNELS (LANES * VECTORS)
#define FETCH(p) UNROLL for (int v = 0; v < CHANNELS; v += 16) __builtin_prefetch((p) + v)
#if LANES == 16
typedef float16 texels_of;
#define STORE(value, to) STORE_PAST_CACHES(value, to)
#else
typedef float4 texels_of;
#define STORE(value, to) (*(to) = (value))
#endif

// One sample in one image: its texel with the lowest coordinates, and its place from there to the next.
typedef struct {
  int x, y, last;  // last: there is no row below
  float fx, fy;
} Texel;

// In the image of all owners (sample.cl: rows, owned).
static inline Texel texel_at(__global const float* points, __global const int* owners, int s, int axes, int image, int owned, int height, int width) {
  const float u = points[axes * s + (image == 2 ? 1 : 0)], v = points[axes * s + (image == 0 ? 1 : 2)];
  const float x = clamp(u * (float)width - 0.5f, 0.0f, (float)(width - 1)), y = clamp(v * (float)height - 0.5f, 0.0f, (float)(height - 1));
  Texel t = {(int)x, (int)y, 0, x - (float)(int)x, y - (float)(int)y};
  t.last = t.y + 1 == height;
  if (owned) t.y += owners[s] * height;
  return t;
}

// Work-items: chunks of samples x images.
FAT __kernel void sample_vectors(__global const float* restrict images, __global const float* restrict points, __global const int* restrict owners,
                                        __global float* restrict out, int n, int axes, int owned, int rows, int height, int width, int chunk) {
  const int image = get_global_id(1), per_sample = get_global_size(1), end = min(n, ((int)get_global_id(0) + 1) * chunk);
  __global const float* texels = images + (size_t)image * rows * width * CHANNELS;
  for (int first = get_global_id(0) * chunk; first < end; first += BLOCK) {
    const int count = min(BLOCK, end - first);
    int at[BLOCK], right[BLOCK], below[BLOCK];
    float fx[BLOCK], fy[BLOCK];
    for (int i = 0; i < count; i++) {
      const Texel t = texel_at(points, owners, first + i, axes, image, owned, height, width);
      at[i] = (t.y * width + t.x) * CHANNELS;
      right[i] = t.x + 1 < width ? CHANNELS : 0;
      below[i] = t.last ? 0 : width * CHANNELS;
      fx[i] = t.fx;
      fy[i] = t.fy;
      __global const float* from = texels + at[i];
      FETCH(from);
      FETCH(from + right[i]);
      FETCH(from + below[i]);
      FETCH(from + below[i] + right[i]);
    }
    for (int i = 0; i < count; i++) {
      __global const texels_of* a = (__global const texels_of*)(texels + at[i]);
      __global const texels_of *b = a + right[i] / LANES, *c = a + below[i] / LANES, *d = c + right[i] / LANES;
      __global texels_of* to = (__global texels_of*)(out + ((size_t)(first + i) * per_sample + image) * CHANNELS);
      UNROLL for (int v = 0; v < VECTORS; v++) {
        const texels_of up = a[v] * (1.0f - fx[i]) + b[v] * fx[i], down = c[v] * (1.0f - fx[i]) + d[v] * fx[i];
        STORE(up * (1.0f - fy[i]) + down * fy[i], to + v);
      }
    }
  }
}

// How many of a chunk's samples touch each band: counts [image][band][chunk].
FAT __kernel void sample_count(__global const float* restrict points, __global const int* restrict owners, __global int* restrict counts, int n,
                               int axes, int owned, int rows, int height, int chunks, int chunk) {
  const int image = get_global_id(1), part = get_global_id(0), bands = (rows + BAND - 1) / BAND;
  __global int* count = counts + (size_t)image * bands * chunks + part;
  for (int b = 0; b < bands; b++) count[b * chunks] = 0;
  const int end = min(n, (part + 1) * chunk);
  for (int s = part * chunk; s < end; s++) {
    const Texel t = texel_at(points, owners, s, axes, image, owned, height, 1);
    const int band = t.y / BAND, next = (t.last ? t.y : t.y + 1) / BAND;
    count[band * chunks]++;
    if (next != band) count[next * chunks]++;
  }
}

// Samples of every band in their order, each with its place in the image: starts [image][band][chunk] is the running sum of
// counts, moved on to the lists' ends.
FAT __kernel void sample_list(__global const float* restrict points, __global const int* restrict owners, __global int* restrict starts,
                              __global int* restrict list, int n, int axes, int owned, int rows, int height, int width, int chunks, int chunk) {
  const int image = get_global_id(1), part = get_global_id(0), bands = (rows + BAND - 1) / BAND;
  __global int* start = starts + (size_t)image * bands * chunks + part;
  const int end = min(n, (part + 1) * chunk);
  for (int s = part * chunk; s < end; s++) {
    const Texel t = texel_at(points, owners, s, axes, image, owned, height, width);
    const int band = t.y / BAND, next = (t.last ? t.y : t.y + 1) / BAND;
    const int4 entry = (int4)(s, t.x | t.y << 16, as_int(t.fx), as_int(t.fy));
    vstore4(entry, start[band * chunks]++, list);
    if (next != band) vstore4(entry, start[next * chunks]++, list);
  }
}

static inline void add_scaled(__global const texels_of* from, float scale, __global texels_of* to) {
  UNROLL for (int v = 0; v < VECTORS; v++) to[v] += scale * from[v];
}

// ends [image][band][chunk]: where the lists end.
FAT __kernel void sample_add(__global const float* restrict g, __global const int* restrict list, __global const int* restrict ends,
                             __global float* restrict dimages, int rows, int height, int width, int chunks) {
  const int image = get_global_id(1), count = get_global_size(1), band = get_global_id(0), bands = get_global_size(0);
  const int place = (image * bands + band) * chunks;
  const int begin = place ? ends[place - 1] : 0, end = ends[place + chunks - 1];
  const int lo = band * BAND, hi = min(rows, lo + BAND), pitch = width * CHANNELS;
  __global float* texels = dimages + (size_t)image * rows * pitch;
  for (int i = lo * pitch; i < hi * pitch; i += LANES) *(__global texels_of*)(texels + i) = (texels_of)(0);
  for (int first = begin; first < end; first += BLOCK) {
    for (int i = min(end, first + BLOCK); i < min(end, first + 2 * BLOCK); i++) {
      const int4 entry = vload4(i, list);
      __global const float* corner = texels + (entry.y >> 16) * pitch + (entry.y & 0xffff) * CHANNELS;
      FETCH(g + ((size_t)entry.x * count + image) * CHANNELS);
      FETCH(corner);
      FETCH(corner + CHANNELS);
      FETCH(corner + pitch);
      FETCH(corner + pitch + CHANNELS);
    }
    for (int i = first; i < min(end, first + BLOCK); i++) {
      const int4 entry = vload4(i, list);
      const int x = entry.y & 0xffff, y = entry.y >> 16, right = x + 1 < width ? CHANNELS : 0, last = (y + 1) % height ? y + 1 : y;
      const float fx = as_float(entry.z), fy = as_float(entry.w);
      __global const texels_of* from = (__global const texels_of*)(g + ((size_t)entry.x * count + image) * CHANNELS);
      __global float *up = texels + y * pitch + x * CHANNELS, *down = texels + last * pitch + x * CHANNELS;
      if (y >= lo) {
        add_scaled(from, (1.0f - fx) * (1.0f - fy), (__global texels_of*)up);
        add_scaled(from, fx * (1.0f - fy), (__global texels_of*)(up + right));
      }
      if (last < hi) {
        add_scaled(from, (1.0f - fx) * fy, (__global texels_of*)down);
        add_scaled(from, fx * fy, (__global texels_of*)(down + right));
      }
    }
  }
}
