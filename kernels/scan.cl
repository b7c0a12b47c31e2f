// Running sums along rows [rows, n] of floats or (INTEGER) integers, which wrap. A row is cut into chunks of a fixed
// length: chunk_sums adds each up, the sums are scanned by the same kernels, scan_chunks adds each chunk's base.
// `reverse` walks rows from their end. A piece is a chunk of a row. version 1.
//: variant scan_chunks reference any LENGTH=4096
//: variant scan_chunks gpu any LENGTH=128
#if INTEGER
typedef uint number;
#else
typedef float number;
#endif

__kernel FAT void chunk_sums(__global const number* restrict in, __global number* restrict sums, int pieces, int n,
                             int chunks, int length, int reverse, int chunk) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    __global const number* from = in + (size_t)(piece / chunks) * n;
    const int begin = piece % chunks * length, end = min(n, begin + length);
    number total = 0;
    for (int i = begin; i < end; i++) total += from[reverse ? n - 1 - i : i];
    sums[piece] = total;
  }
}

// Sums within the chunk start at 0 and the base is added last: the next base is then this chunk's last value, so that
// running sums of numbers >= 0 do not step down where a chunk ends (a rounding of the bases apart, where their own sums
// took several chunks).
__kernel FAT void scan_chunks(__global const number* restrict in, __global const number* bases,
                              __global number* restrict out, int pieces, int n, int chunks, int length, int reverse,
                              int exclusive, int chunk, int past) {
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const size_t row = (size_t)(piece / chunks) * n;
    const int begin = piece % chunks * length, end = min(n, begin + length);
    const number base = chunks > 1 ? bases[piece] : 0;
    number total = 0;
    for (int i = begin; i < end; i++) {
      const size_t at = row + (reverse ? n - 1 - i : i);
      const number before = total;
      total += in[at];
      out[at] = base + (exclusive ? before : total);
    }
  }
}
