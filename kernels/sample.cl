// Bilinear sampling with half-pixel centres and border padding, channels last: a chunk of samples a work-item. images
// [P,A,H,W,C] of A owners, one for each pair of the axes of points [S,axes] in [0,1]: of 2 axes one image (xy), of 3 axes
// three planes (xy, xz, yz) -> [S,P C]. owners [S] says whose images a sample reads (owned 0: there is one owner, and owners
// is not read). The images' gradient lists (texel, value) pairs for a deterministic scatter. rows = A H, of which an owner
// has height.
//: variant sample_images reference any
//: variant sample_images gpu any
#define IMAGES(axes) ((axes) == 3 ? 3 : 1)
#define AXIS_U(image) ((image) == 2 ? 1 : 0)
#define AXIS_V(image) ((image) == 0 ? 1 : 2)

typedef struct {
  int x0, x1, y0, y1;
  float fx, fy;
} Texel;

static inline Texel texel_at(__global const float* restrict point, int image, int height, int width) {
  const float u = point[AXIS_U(image)], v = point[AXIS_V(image)];
  const float x = clamp(u * (float)width - 0.5f, 0.0f, (float)(width - 1)), y = clamp(v * (float)height - 0.5f, 0.0f, (float)(height - 1));
  Texel t;
  t.x0 = (int)x;
  t.y0 = (int)y;
  t.x1 = min(t.x0 + 1, width - 1);
  t.y1 = min(t.y0 + 1, height - 1);
  t.fx = x - (float)t.x0;
  t.fy = y - (float)t.y0;
  return t;
}

static inline int first_row(__global const int* restrict owners, int s, int owned, int height) { return owned ? owners[s] * height : 0; }

FAT __kernel void sample_images(__global const float* restrict images, __global const float* restrict points, __global const int* restrict owners,
                                __global float* restrict out, int n, int axes, int owned, int rows, int height, int width, int channels, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk), count = IMAGES(axes);
  for (int s = get_global_id(0) * chunk; s < end; s++)
    for (int image = 0; image < count; image++) {
      const Texel t = texel_at(points + (size_t)s * axes, image, height, width);
      __global const float* first = images + ((size_t)image * rows + first_row(owners, s, owned, height)) * width * channels;
      __global const float* row0 = first + (size_t)t.y0 * width * channels;
      __global const float* row1 = first + (size_t)t.y1 * width * channels;
      __global const float *a = row0 + t.x0 * channels, *b = row0 + t.x1 * channels, *c = row1 + t.x0 * channels, *d = row1 + t.x1 * channels;
      __global float* to = out + ((size_t)s * count + image) * channels;
      for (int i = 0; i < channels; i++)
        to[i] = (a[i] * (1.0f - t.fx) + b[i] * t.fx) * (1.0f - t.fy) + (c[i] * (1.0f - t.fx) + d[i] * t.fx) * t.fy;
    }
}

__kernel void sample_pairs(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict g,
                           __global int* restrict row_of, __global float* restrict value, int n, int axes, int owned, int rows, int height,
                           int width, int channels) {
  const int item = get_global_id(0), count = IMAGES(axes);
  if (item >= n * count) return;
  const int s = item / count, image = item % count;
  const Texel t = texel_at(points + (size_t)s * axes, image, height, width);
  const int first = image * rows + first_row(owners, s, owned, height);
  for (int k = 0; k < 4; k++) {
    const int y = k < 2 ? t.y0 : t.y1, x = (k & 1) ? t.x1 : t.x0;
    const float w = ((k & 1) ? t.fx : 1.0f - t.fx) * (k < 2 ? 1.0f - t.fy : t.fy);
    row_of[item * 4 + k] = (first + y) * width + x;
    for (int i = 0; i < channels; i++) value[((size_t)item * 4 + k) * channels + i] = w * g[(size_t)item * channels + i];
  }
}

// dpoints [S,axes]; zero along an axis where the coordinate is clamped to the border.
FAT __kernel void sample_dpoints(__global const float* restrict images, __global const float* restrict points, __global const int* restrict owners,
                                 __global const float* restrict g, __global float* restrict dpoints, int n, int axes, int owned, int rows,
                                 int height, int width, int channels, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk), count = IMAGES(axes);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    __global const float* point = points + (size_t)s * axes;
    float total[3] = {0.0f, 0.0f, 0.0f};
    for (int image = 0; image < count; image++) {
      const Texel t = texel_at(point, image, height, width);
      __global const float* first = images + ((size_t)image * rows + first_row(owners, s, owned, height)) * width * channels;
      float du = 0.0f, dv = 0.0f;
      for (int i = 0; i < channels; i++) {
        const float a = first[((size_t)t.y0 * width + t.x0) * channels + i];
        const float b = first[((size_t)t.y0 * width + t.x1) * channels + i];
        const float c = first[((size_t)t.y1 * width + t.x0) * channels + i];
        const float d = first[((size_t)t.y1 * width + t.x1) * channels + i];
        const float gi = g[((size_t)s * count + image) * channels + i];
        du += gi * ((b - a) * (1.0f - t.fy) + (d - c) * t.fy);
        dv += gi * ((c - a) * (1.0f - t.fx) + (d - b) * t.fx);
      }
      const float u = point[AXIS_U(image)] * (float)width - 0.5f, v = point[AXIS_V(image)] * (float)height - 0.5f;
      if (u > 0.0f && u < (float)(width - 1)) total[AXIS_U(image)] += du * (float)width;
      if (v > 0.0f && v < (float)(height - 1)) total[AXIS_V(image)] += dv * (float)height;
    }
    for (int i = 0; i < axes; i++) dpoints[s * axes + i] = total[i];
  }
}
