// Sums over segments (kernels/segments.cl) on CPU devices, in vectors of 16 numbers. A part is a chunk of places. It
// fills the rows of `out` whose segments begin in it, heads[part,:] takes what it holds of a segment that began before.
// Segments that reach into further parts get those parts' heads by join_heads, in order.
// ORDERED: the row at place k is order[k]. FLAT: rows lie in order, and 16 is a multiple of their width: a vector holds
// several.
//: variant segment_sum cpu sum

// The first segment that begins at `place` or later.
static inline int first_from(__global const int* offsets, int segments, int place) {
  int low = 0, high = segments;
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (offsets[middle] < place)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

// Columns c to c + 15 of the rows at the places [begin, end).
INLINE float16 sum_rows(__global const float* values, __global const int* order, int begin, int end, int c, int width,
                        int n) {
  float16 sum = (float16)(0.0f);
  for (int k = begin; k < end; k++) {
    const size_t row = ORDERED ? order[k] : k, at = row * width + c;
    sum += read_first(values + at, width - c, (int)min((size_t)16, (size_t)n * width - at));
  }
  return sum;
}

// Numbers [begin, end) of n, 16 by 16.
INLINE float16 sum_lanes(__global const float* values, size_t begin, size_t end, size_t n) {
  float16 sum = (float16)(0.0f);
  for (; begin + 16 <= end; begin += 16) sum += vload16(0, values + begin);
  if (begin < end) sum += read_first(values + begin, (int)(end - begin), (int)min((size_t)16, n - begin));
  return sum;
}

// The rows of `width` numbers in a vector, which width divides, added up.
INLINE float16 add_rows(float16 sum, int width) {
  if (width <= 8) sum.lo += sum.hi;
  if (width <= 4) sum.lo.lo += sum.lo.hi;
  if (width <= 2) sum.s01 += sum.s23;
  if (width <= 1) sum.s0 += sum.s1;
  return sum;
}

// 16 segments of single numbers: as 16 times sum_lanes and add_rows, but their last additions are made side by side.
INLINE float16 sum_16(__global const float* values, __global const int* offsets, int begin, int end, int n) {
  float16 r[16];
  const int16 lengths = vload16(0, offsets + 1) - vload16(0, offsets);
  if (offsets[16] <= end && offsets[16] + 16 <= n && !any(lengths > 16))
    UNROLL for (int j = 0; j < 16; j++)
      r[j] = select((float16)(0.0f), vload16(0, values + offsets[j]), LANE_NUMBERS < offsets[j + 1] - offsets[j]);
  else
    for (int j = 0; j < 16; j++) {
      const int from = clamp(offsets[j], begin, end);
      r[j] = sum_lanes(values, from, clamp(offsets[j + 1], from, end), n);
    }
  transpose16(r);
  UNROLL for (int i = 0; i < 8; i++) r[i] += r[i + 8];
  UNROLL for (int i = 0; i < 4; i++) r[i] += r[i + 4];
  return (r[0] + r[2]) + (r[1] + r[3]);
}

INLINE void sum_places(__global const float* values, __global const int* order, __global float* to, int begin, int end,
                       int width, int n) {
  if (FLAT) {
    const size_t all = (size_t)n * width;
    const float16 sum = add_rows(sum_lanes(values, (size_t)begin * width, (size_t)end * width, all), width);
    if (width == 1)
      to[0] = sum.s0;
    else
      write_first(sum, to, width);
  } else {
    for (int c = 0; c < width; c += 16)
      write_first(sum_rows(values, order, begin, end, c, width, n), to + c, width - c);
  }
}

__kernel FAT void segment_sum(__global const float* restrict values, __global const int* restrict order,
                              __global const int* restrict offsets, __global float* restrict out,
                              __global float* restrict heads, int parts, int n, int segments, int width, int length) {
  const int part = get_global_id(0), begin = part * length, end = part + 1 < parts ? begin + length : n;
  int segment = part > 0 ? first_from(offsets, segments, begin) : 0;
  if (segment > 0) sum_places(values, order, heads + (size_t)part * width, begin, clamp(offsets[segment], begin, end), width, n);
  const int stop = part + 1 < parts ? first_from(offsets, segments, end) : segments;
  for (; FLAT && width == 1 && segment + 16 <= stop; segment += 16)
    store16(sum_16(values, offsets + segment, begin, end, n), out + segment);
  for (; segment < stop; segment++) {
    const int from = clamp(offsets[segment], begin, end), to = clamp(offsets[segment + 1], from, end);
    sum_places(values, order, out + (size_t)segment * width, from, to, width, n);
  }
}

// A work-item a part: it joins the segment that is the first to reach into it, if there is one.
__kernel FAT void join_heads(__global const int* restrict offsets, __global const float* restrict heads,
                             __global float* restrict out, int parts, int segments, int width, int length) {
  const int part = get_global_id(0);
  if (part == 0) return;
  const int segment = first_from(offsets, segments, part * length) - 1;
  if (segment < 0 || (part > 1 && offsets[segment] < (part - 1) * length)) return;
  __global float* to = out + (size_t)segment * width;
  for (int next = part; next < parts && next * length < offsets[segment + 1]; next++)
    for (int c = 0; c < width; c++) to[c] += heads[(size_t)next * width + c];
}
