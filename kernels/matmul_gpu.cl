// Version 2 of matmul.cl, for GPUs: a group of SIDE x SIDE lanes computes a tile of TM x TN elements of C, a lane RM x RN
// of them in registers, as quads 4 SIDE apart so that neighbours read neighbouring words of local memory. Strips of A and
// B, TK deep, are staged there with loads along whichever axis is contiguous. Sums run over k in ascending order for
// any tile.
//: variant matmul_tiled gpu any LANES=256 RM=4 RN=4 TK=16
//: variant matmul_tiled gpu any LANES=64 RM=4 RN=4 TK=16
//: variant matmul_tiled gpu large LANES=256 RM=8 RN=8 TK=16
//: variant matmul_tiled gpu large LANES=256 RM=4 RN=8 TK=16
//: variant matmul_tiled gpu large LANES=256 RM=4 RN=4 TK=16
//: variant matmul_tiled gpu large LANES=64 RM=8 RN=8 TK=16
//: variant matmul_tiled gpu large LANES=64 RM=4 RN=4 TK=16
#define SIDE (LANES == 64 ? 8 : 16)
#define TM (SIDE * RM)
#define TN (SIDE * RN)
#define VM (RM / 4)
#define VN (RN / 4)

// strip[k][o] = from[o0 + o, k0 + k], zero outside `outers` x `depth`; the lanes take a quad each, along k or along o,
// whichever is contiguous; the other axis has stride `pitch`.
static inline void stage(__local float* strip, int width, __global const float* restrict from, int along_k, int pitch, int o0,
                         int outers, int k0, int depth, int lane) {
  for (int quad = lane; quad < width * TK / 4; quad += LANES) {
    const int o = along_k ? quad / (TK / 4) : quad % (width / 4) * 4;
    const int k = along_k ? quad % (TK / 4) * 4 : quad / (width / 4);
    const int inner = along_k ? k0 + k : o0 + o, inners = along_k ? depth : outers;
    const int outside = along_k ? o0 + o >= outers : k0 + k >= depth;
    __global const float* at = from + (size_t)(along_k ? o0 + o : k0 + k) * pitch + inner;
    float4 value = (float4)(0.0f);
    if (!outside && inner + 4 <= inners) {
      value = vload4(0, at);
    } else if (!outside) {
      if (inner < inners) value.x = at[0];
      if (inner + 1 < inners) value.y = at[1];
      if (inner + 2 < inners) value.z = at[2];
    }
    __local float* to = strip + k * (width + 4) + o;
    if (along_k) {
      to[0] = value.x;
      to[width + 4] = value.y;
      to[2 * (width + 4)] = value.z;
      to[3 * (width + 4)] = value.w;
    } else {
      vstore4(value, 0, to);
    }
  }
}

// Group (x, y, z): tile (y, x) of C; z = batch * splits + split. A split sums k_each of the depth into its own c[z];
// add_splits joins them.
__attribute__((reqd_work_group_size(SIDE, SIDE, 1))) __kernel void matmul_tiled(
    __global const float* restrict a, int a_offset, __global const float* restrict b, int b_offset,
    __global float* restrict c, int m, int n, int depth, int a_batch, int a_pitch, int b_batch, int b_pitch, int splits,
    int k_each, __global const float* restrict bias, __global const float* restrict residual, int epilogue) {
  __local float a_strip[TK * (TM + 4)], b_strip[TK * (TN + 4)];
  const int x = get_local_id(0), y = get_local_id(1), lane = y * SIDE + x;
  const int i0 = get_group_id(1) * TM, j0 = get_group_id(0) * TN;
  const int z = get_group_id(2), batch = z / splits, k_begin = (z - batch * splits) * k_each;
  const int k_end = min(depth, k_begin + k_each);
  a += a_offset + (size_t)batch * a_batch;
  b += b_offset + (size_t)batch * b_batch;
  float4 acc[RM][VN];
  UNROLL for (int i = 0; i < RM; i++) UNROLL for (int v = 0; v < VN; v++) acc[i][v] = (float4)(0.0f);
  for (int k0 = k_begin; k0 < k_end; k0 += TK) {
    stage(a_strip, TM, a, !A_BY_COLUMN, a_pitch, i0, m, k0, k_end, lane);
    stage(b_strip, TN, b, B_BY_COLUMN, b_pitch, j0, n, k0, k_end, lane);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = 0; k < TK; k++) {
      float4 column[VM], row[VN];
      UNROLL for (int v = 0; v < VM; v++) column[v] = vload4(0, a_strip + k * (TM + 4) + v * 4 * SIDE + y * 4);
      UNROLL for (int v = 0; v < VN; v++) row[v] = vload4(0, b_strip + k * (TN + 4) + v * 4 * SIDE + x * 4);
      UNROLL for (int u = 0; u < VM; u++) UNROLL for (int v = 0; v < VN; v++) {
        acc[u * 4][v] += column[u].x * row[v];
        acc[u * 4 + 1][v] += column[u].y * row[v];
        acc[u * 4 + 2][v] += column[u].z * row[v];
        acc[u * 4 + 3][v] += column[u].w * row[v];
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  UNROLL for (int r = 0; r < RM; r++) UNROLL for (int v = 0; v < VN; v++) {
    const int i = i0 + r / 4 * 4 * SIDE + y * 4 + r % 4;
    float values[4];
    vstore4(acc[r][v], 0, values);
    UNROLL for (int q = 0; q < 4; q++) {
      const int j = j0 + v * 4 * SIDE + x * 4 + q;
      if (i < m && j < n) {
        float sum = values[q];
        if (epilogue & EPILOGUE_BIAS) sum += bias[j];
        if (epilogue & EPILOGUE_RESIDUAL) sum += residual[((size_t)batch * m + i) * n + j];
        c[((size_t)z * m + i) * n + j] = activate(sum, epilogue);
      }
    }
  }
}

// c[b][e] = end of sum over s of parts[b][s][e], in the order of s.
__kernel void add_splits(__global const float* restrict parts, __global float* restrict c, int m, int n, int splits,
                         __global const float* restrict bias, __global const float* restrict residual, int epilogue) {
  const int e = get_global_id(0), count = m * n;
  if (e >= count) return;
  const size_t batch = get_global_id(1), to = batch * count + e;
  float sum = parts[batch * splits * count + e];
  for (int s = 1; s < splits; s++) sum += parts[(batch * splits + s) * count + e];
  if (epilogue & EPILOGUE_BIAS) sum += bias[e % n];
  if (epilogue & EPILOGUE_RESIDUAL) sum += residual[to];
  c[to] = activate(sum, epilogue);
}
