// Rows by number: gather_rows out[i,:] = table[rows[i],:], and its transpose, the sum of value rows that share a
// number. Rows hold `width` numbers; row numbers outside the table count as its nearest row. A piece is a row on CPU
// devices, a row's column on GPU devices, so no two work-items ever add into one place. version 1.

static inline int inside(int row, int count) { return clamp(row, 0, count - 1); }

// WIDTH 1: rows of one number, the width known when compiled. 0: any width.
__kernel FAT void gather_rows(__global const element* restrict table, __global const int* restrict rows,
                              __global element* restrict out, int pieces, int count, int any_width, int chunk) {
  const int width = WIDTH ? WIDTH : any_width;
  for (int piece = LOOP_LO(chunk); piece < LOOP_HI(pieces, chunk); piece += LOOP_STEP) {
    const int i = CLOAM_CPU ? piece : piece / width;
    const int left = CLOAM_CPU ? 0 : piece % width, right = CLOAM_CPU ? width : left + 1;
    __global const element* from = table + (size_t)inside(rows[i], count) * width;
    __global element* to = out + (size_t)i * width;
    for (int c = left; c < right; c++) to[c] = from[c];
  }
}

// For few rows: chunks of the values each add into a copy [count, width] of their own; add_copies sums these in order.
__kernel FAT void scatter_copies(__global const float* restrict values, __global const int* restrict rows,
                                 __global float* restrict copies, int pieces, int n, int count, int width, int length) {
  const int piece = get_global_id(0);
  if (piece >= pieces) return;
  const int part = CLOAM_CPU ? piece : piece / width;
  const int left = CLOAM_CPU ? 0 : piece % width, right = CLOAM_CPU ? width : left + 1;
  __global float* copy = copies + (size_t)part * count * width;
  for (int row = 0; row < count; row++)
    for (int c = left; c < right; c++) copy[(size_t)row * width + c] = 0;
  const int end = min(n, (part + 1) * length);
  for (int i = part * length; i < end; i++) {
    __global const float* from = values + (size_t)i * width;
    __global float* to = copy + (size_t)inside(rows[i], count) * width;
    for (int c = left; c < right; c++) to[c] += from[c];
  }
}

__kernel FAT void add_copies(__global const float* restrict copies, __global float* restrict out, int numbers,
                             int parts, int chunk) {
  const int end = LOOP_HI(numbers, chunk);
  for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) out[i] = copies[i];
  for (int part = 1; part < parts; part++)
    for (int i = LOOP_LO(chunk); i < end; i += LOOP_STEP) out[i] += copies[(size_t)part * numbers + i];
}
