// C[b] = A[b] B[b] for any strides: element (i, k) of A lies at a_offset + b * a_batch + i * a_row + k * a_column. C is
// dense [batch, m, n]. `epilogue`, bias [n] and residual (as C): prelude.cl.
// version 1, matmul_reference: a work-item is an element of C. Versions 2 and 3: matmul_gpu.cl, matmul_cpu.cl.
//: variant matmul_reference reference any

__kernel void matmul_reference(__global const float* restrict a, int a_offset, __global const float* restrict b,
                               int b_offset, __global float* restrict c, int m, int n, int depth, int a_batch,
                               int a_row, int a_column, int b_batch, int b_row, int b_column,
                               __global const float* restrict bias, __global const float* restrict residual,
                               int epilogue) {
  const int element = get_global_id(0);
  if (element >= m * n) return;
  const int i = element / n, j = element - i * n;
  const size_t batch = get_global_id(1), to = batch * m * n + element;
  a += a_offset + batch * a_batch + (size_t)i * a_row;
  b += b_offset + batch * b_batch + (size_t)j * b_column;
  float sum = 0.0f;
  for (int k = 0; k < depth; k++) sum += a[(size_t)k * a_column] * b[(size_t)k * b_row];
  if (epilogue & EPILOGUE_BIAS) sum += bias[j];
  if (epilogue & EPILOGUE_RESIDUAL) sum += residual[to];
  c[to] = activate(sum, epilogue);
}
