// C[b] = A[b] B[b] for any strides: element (i, k) of A lies at a_offset + b * a_batch + i * a_row + k * a_column.
// version 1, matmul_reference: a work-item is an element of C. version 2, matmul_tiled: groups of TILE x TILE share
// tiles of A and B in local memory (GPUs). version 3 is matmul_cpu.cl. C is dense [batch, m, n].

__kernel void matmul_reference(__global const float* restrict a, int a_offset, __global const float* restrict b,
                               int b_offset, __global float* restrict c, int m, int n, int depth, int a_batch,
                               int a_row, int a_column, int b_batch, int b_row, int b_column) {
  const int element = get_global_id(0);
  if (element >= m * n) return;
  const int i = element / n, j = element - i * n;
  const size_t batch = get_global_id(1);
  a += a_offset + batch * a_batch + (size_t)i * a_row;
  b += b_offset + batch * b_batch + (size_t)j * b_column;
  float sum = 0.0f;
  for (int k = 0; k < depth; k++) sum += a[(size_t)k * a_column] * b[(size_t)k * b_row];
  c[batch * m * n + element] = sum;
}

#if !CLOAM_CPU
#define TILE 16
__attribute__((reqd_work_group_size(TILE, TILE, 1))) __kernel void matmul_tiled(
    __global const float* restrict a, int a_offset, __global const float* restrict b, int b_offset,
    __global float* restrict c, int m, int n, int depth, int a_batch, int a_row, int a_column, int b_batch, int b_row,
    int b_column) {
  __local float a_tile[TILE][TILE + 1], b_tile[TILE][TILE + 1];
  const int x = get_local_id(0), y = get_local_id(1);
  const int i = get_global_id(1), j = get_global_id(0);
  const size_t batch = get_global_id(2);
  a += a_offset + batch * a_batch;
  b += b_offset + batch * b_batch;
  float sum = 0.0f;
  for (int k0 = 0; k0 < depth; k0 += TILE) {
    a_tile[y][x] = i < m && k0 + x < depth ? a[(size_t)i * a_row + (size_t)(k0 + x) * a_column] : 0.0f;
    b_tile[y][x] = j < n && k0 + y < depth ? b[(size_t)(k0 + y) * b_row + (size_t)j * b_column] : 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = 0; k < TILE; k++) sum += a_tile[y][k] * b_tile[k][x];
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  if (i < m && j < n) c[(batch * m + i) * n + j] = sum;
}
#endif
