// Tri-plane features: points [S,3] in [0,1]^3, planes [3,A,H,W,C] (xy, xz, yz of each of A owners; channels last) ->
// [S,3C], bilinear with half-pixel centres and border padding: a chunk of samples a work-item. owners [S] says whose
// planes a sample reads (owned 0: there is one owner, and owners is not read). The planes' gradient lists (texel, value)
// pairs for a deterministic scatter. A plane has rows = A H rows, of which an owner has height.
//: variant sample_planes reference any
//: variant sample_planes gpu any
typedef struct {
  int x0, x1, y0, y1;
  float fx, fy;
} Texel;

inline Texel texel_at(__global const float* restrict points, int s, int plane, int height, int width) {
  const float3 p = vload3(s, points);
  const float u = plane == 2 ? p.y : p.x, v = plane == 0 ? p.y : p.z;
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

inline int first_row(__global const int* restrict owners, int s, int owned, int height) { return owned ? owners[s] * height : 0; }

FAT __kernel void sample_planes(__global const float* restrict planes, __global const float* restrict points, __global const int* restrict owners,
                                __global float* restrict out, int n, int owned, int rows, int height, int width, int channels, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++)
    for (int plane = 0; plane < 3; plane++) {
      const Texel t = texel_at(points, s, plane, height, width);
      __global const float* first = planes + ((size_t)plane * rows + first_row(owners, s, owned, height)) * width * channels;
      __global const float* row0 = first + (size_t)t.y0 * width * channels;
      __global const float* row1 = first + (size_t)t.y1 * width * channels;
      __global const float *a = row0 + t.x0 * channels, *b = row0 + t.x1 * channels, *c = row1 + t.x0 * channels, *d = row1 + t.x1 * channels;
      __global float* to = out + ((size_t)s * 3 + plane) * channels;
      for (int i = 0; i < channels; i++)
        to[i] = (a[i] * (1.0f - t.fx) + b[i] * t.fx) * (1.0f - t.fy) + (c[i] * (1.0f - t.fx) + d[i] * t.fx) * t.fy;
    }
}

__kernel void sample_planes_pairs(__global const float* restrict points, __global const int* restrict owners, __global const float* restrict g,
                                  __global int* restrict row_of, __global float* restrict value, int n, int owned, int rows, int height,
                                  int width, int channels) {
  const int item = get_global_id(0);
  if (item >= n * 3) return;
  const int plane = item % 3;
  const Texel t = texel_at(points, item / 3, plane, height, width);
  const int first = plane * rows + first_row(owners, item / 3, owned, height);
  for (int k = 0; k < 4; k++) {
    const int y = k < 2 ? t.y0 : t.y1, x = (k & 1) ? t.x1 : t.x0;
    const float w = ((k & 1) ? t.fx : 1.0f - t.fx) * (k < 2 ? 1.0f - t.fy : t.fy);
    row_of[item * 4 + k] = (first + y) * width + x;
    for (int i = 0; i < channels; i++) value[((size_t)item * 4 + k) * channels + i] = w * g[(size_t)item * channels + i];
  }
}

// dpoints [S,3]; zero along an axis where the coordinate is clamped to the border.
FAT __kernel void sample_planes_dpoints(__global const float* restrict planes, __global const float* restrict points, __global const int* restrict owners,
                                        __global const float* restrict g, __global float* restrict dpoints, int n, int owned, int rows, int height,
                                        int width, int channels, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    float total[3] = {0.0f, 0.0f, 0.0f};
    for (int plane = 0; plane < 3; plane++) {
      const Texel t = texel_at(points, s, plane, height, width);
      __global const float* first = planes + ((size_t)plane * rows + first_row(owners, s, owned, height)) * width * channels;
      float du = 0.0f, dv = 0.0f;
      for (int i = 0; i < channels; i++) {
        const float a = first[((size_t)t.y0 * width + t.x0) * channels + i];
        const float b = first[((size_t)t.y0 * width + t.x1) * channels + i];
        const float c = first[((size_t)t.y1 * width + t.x0) * channels + i];
        const float d = first[((size_t)t.y1 * width + t.x1) * channels + i];
        const float gi = g[((size_t)s * 3 + plane) * channels + i];
        du += gi * ((b - a) * (1.0f - t.fy) + (d - c) * t.fy);
        dv += gi * ((c - a) * (1.0f - t.fx) + (d - b) * t.fx);
      }
      const float3 p = vload3(s, points);
      const float u = (plane == 2 ? p.y : p.x) * (float)width - 0.5f, v = (plane == 0 ? p.y : p.z) * (float)height - 0.5f;
      if (u > 0.0f && u < (float)(width - 1)) total[plane == 2 ? 1 : 0] += du * (float)width;
      if (v > 0.0f && v < (float)(height - 1)) total[plane == 0 ? 1 : 2] += dv * (float)height;
    }
    for (int i = 0; i < 3; i++) dpoints[3 * s + i] = total[i];
  }
}
