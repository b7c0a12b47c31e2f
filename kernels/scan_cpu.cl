// Running sums (kernels/scan.cl says what is computed) on CPU devices, 16 numbers at a time.
//: variant scan_chunks cpu any LENGTH=4096
#if INTEGER
typedef uint number;
typedef uint16 numbers;
#else
typedef float number;
typedef float16 numbers;
#endif

INLINE numbers running(numbers v) {
  const numbers none = (numbers)(0);
  v += BELOW1(v, none);
  v += BELOW2(v, none);
  v += BELOW4(v, none);
  return v + BELOW8(v, none);
}

// The bits of running(v).sf.
INLINE number sum_of(numbers v) {
  v.lo = v.even + v.odd;
  v.lo.lo = v.lo.even + v.lo.odd;
  return (v.s0 + v.s1) + (v.s2 + v.s3);
}

// The 16 numbers at place i of a row's walk.
INLINE numbers read(__global const number* row, int i, int n, int reverse) {
  return reverse ? vload16(0, row + n - 16 - i).sfedcba9876543210 : vload16(0, row + i);
}

__kernel FAT void chunk_sums(__global const number* restrict in, __global number* restrict sums, int pieces, int n,
                             int chunks, int length, int reverse, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece++) {
    __global const number* row = in + (size_t)(piece / chunks) * n;
    const int begin = piece % chunks * length, end = min(n, begin + length);
    number total = 0;
    int i = begin;
    for (; i + 16 <= end; i += 16) total += sum_of(read(row, i, n, reverse));
    for (; i < end; i++) total += row[reverse ? n - 1 - i : i];
    sums[piece] = total;
  }
}

// past: stores go past the caches; out and n are multiples of 16 numbers.
__kernel FAT void scan_chunks(__global const number* restrict in, __global const number* bases,
                              __global number* restrict out, int pieces, int n, int chunks, int length, int reverse,
                              int exclusive, int chunk, int past) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece++) {
    const size_t at = (size_t)(piece / chunks) * n;
    __global const number* row = in + at;
    __global number* to = out + at;
    const int begin = piece % chunks * length, end = min(n, begin + length);
    const number base = chunks > 1 ? bases[piece] : 0;
    number total = 0;
    int i = begin;
    for (; i + 16 <= end; i += 16) {
      numbers sums = running(read(row, i, n, reverse));
      const number last = sums.sf;
      if (exclusive) sums = ONE_BEFORE(sums, (numbers)(0));
      sums = base + (total + sums);
      total += last;
      if (reverse) sums = sums.sfedcba9876543210;
      __global number* place = to + (reverse ? n - 16 - i : i);
      if (past)
        STORE_PAST_CACHES(sums, (__global numbers*)place);
      else
        vstore16(sums, 0, place);
    }
    for (; i < end; i++) {
      const int place = reverse ? n - 1 - i : i;
      const number before = total;
      total += row[place];
      to[place] = base + (exclusive ? before : total);
    }
  }
}
