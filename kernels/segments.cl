// Sums over segments: rows that lie one after another under one number. version 1.
//: variant segment_sum reference sum
//: variant segment_sum gpu sum

// The first place from `low` on that holds `value` or more, in ascending numbers: steps that double, then bisection.
static inline int first_at_least(__global const int* numbers, int low, int n, int value) {
  int step = 1;
  while (step <= n - low && numbers[low + step - 1] < value) {
    low += step;
    step *= 2;
  }
  int high = low + min(step - 1, n - low);
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (numbers[middle] < value)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

__kernel FAT void segment_offsets(__global const int* restrict ids, __global int* restrict offsets, int count, int n,
                                  int chunk) {
  int low = 0;
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    low = first_at_least(ids, low, n, i);
    offsets[i] = low;
  }
}

// out[segment,:] = the sum of its value rows (ORDERED: row order[k] for each place k). Chunks of places share the work,
// so that one long segment keeps no work-item busy alone: what a chunk holds of a segment that began before it goes to
// heads[chunk,:], and join_heads adds these in order. A piece is a chunk, on GPU devices a chunk's column.
__kernel FAT void segment_sum(__global const float* restrict values, __global const int* restrict order,
                              __global const int* restrict offsets, __global float* restrict out,
                              __global float* restrict heads, int pieces, int n, int segments, int width, int length) {
  const int piece = get_global_id(0);
  if (piece >= pieces) return;
  const int part = CLOAM_CPU ? piece : piece / width;
  const int left = CLOAM_CPU ? 0 : piece % width, right = CLOAM_CPU ? width : left + 1;
  const int begin = part * length, end = min(min(n, begin + length), offsets[segments]);
  int low = 0, stop = 0;
  for (int k = max(begin, offsets[0]); k < end; k = stop) {
    low = first_at_least(offsets, low, segments + 1, k + 1);
    const int segment = clamp(low - 1, 0, segments - 1);
    stop = max(k + 1, min(end, offsets[segment + 1]));
    __global float* to = offsets[segment] < begin ? heads + (size_t)part * width : out + (size_t)segment * width;
    for (int c = left; c < right; c++) to[c] = 0;
    for (int i = k; i < stop; i++) {
      __global const float* from = values + (size_t)(ORDERED ? order[i] : i) * width;
      for (int c = left; c < right; c++) to[c] += from[c];
    }
  }
}

__kernel FAT void join_heads(__global const int* restrict offsets, __global const float* restrict heads,
                             __global float* restrict out, int pieces, int n, int width, int length, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int segment = CLOAM_CPU ? piece : piece / width;
    const int left = CLOAM_CPU ? 0 : piece % width, right = CLOAM_CPU ? width : left + 1;
    const int begin = max(0, offsets[segment]), end = min(n, offsets[segment + 1]);
    __global float* to = out + (size_t)segment * width;
    for (int c = left; c < right && begin >= end; c++) to[c] = 0;
    for (int part = begin / length + 1; part * length < end; part++)
      for (int c = left; c < right; c++) to[c] += heads[(size_t)part * width + c];
  }
}

// The transpose: out[i,:] = of[segment of i,:], zero where i is in no segment.
__kernel FAT void segment_spread(__global const float* restrict of, __global const int* restrict offsets,
                                 __global float* restrict out, int pieces, int segments, int any_width, int chunk) {
  const int width = WIDTH ? WIDTH : any_width;
  int low = 0;
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int i = CLOAM_CPU ? piece : piece / width;
    const int left = CLOAM_CPU ? 0 : piece % width, right = CLOAM_CPU ? width : left + 1;
    low = first_at_least(offsets, low, segments + 1, i + 1);
    const int segment = low - 1;
    __global float* to = out + (size_t)i * width;
    if (segment < 0 || segment >= segments) {
      for (int c = left; c < right; c++) to[c] = 0;
    } else {
      __global const float* from = of + (size_t)segment * width;
      for (int c = left; c < right; c++) to[c] = from[c];
    }
  }
}
