// Copies between row-structured tensors of BYTES-wide elements.
// in [outer, run] -> out [outer, pitch] at column `begin`; pad_ writes zeros elsewhere.
// version 1: a work-item copies whole runs (a chunk of them on CPU devices).
//: variant copy_rows reference concat
//: variant pad_rows reference pad
//: variant copy_rows cpu concat
//: variant pad_rows cpu pad
// On GPU devices a work-item is an element, and neighbours copy neighbours: a single long run keeps all lanes busy.
//: variant copy_elements gpu concat
//: variant pad_elements gpu pad

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

// A work-item an element of in: count = outer * run of them.
__kernel void copy_elements(__global const element* restrict in, __global element* restrict out, int count, int run, int pitch,
                            int begin) {
  const int i = get_global_id(0);
  if (i >= count) return;
  const int row = i / run;
  out[(size_t)row * pitch + begin + (i - row * run)] = in[i];
}

// A work-item an element of out: count = outer * pitch of them.
__kernel void pad_elements(__global const element* restrict in, __global element* restrict out, int count, int run, int pitch,
                           int begin) {
  const int i = get_global_id(0);
  if (i >= count) return;
  const int row = i / pitch, column = i - row * pitch - begin;
  element value = 0;
  if (column >= 0 && column < run) value = in[(size_t)row * run + column];
  out[i] = value;
}
