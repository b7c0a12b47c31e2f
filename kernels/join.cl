// Copies between row-structured tensors of BYTES-wide elements. version 1: a work-item copies whole runs.
// copy_rows: in [outer, run] -> out [outer, pitch] at column `begin`. pad_rows: the same, zeros elsewhere.

__kernel void copy_rows(__global const element* restrict in, __global element* restrict out, int outer, int run, int pitch,
                        int begin, int per_item) {
  const int end = min(outer, ((int)get_global_id(0) + 1) * per_item);
  for (int row = get_global_id(0) * per_item; row < end; row++) {
    __global const element* from = in + (size_t)row * run;
    __global element* to = out + (size_t)row * pitch + begin;
    for (int i = 0; i < run; i++) to[i] = from[i];
  }
}

__kernel void pad_rows(__global const element* restrict in, __global element* restrict out, int outer, int run, int pitch,
                       int begin, int per_item) {
  const int end = min(outer, ((int)get_global_id(0) + 1) * per_item);
  for (int row = get_global_id(0) * per_item; row < end; row++) {
    __global const element* from = in + (size_t)row * run;
    __global element* to = out + (size_t)row * pitch;
    for (int i = 0; i < begin; i++) to[i] = 0;
    for (int i = 0; i < run; i++) to[begin + i] = from[i];
    for (int i = begin + run; i < pitch; i++) to[i] = 0;
  }
}
