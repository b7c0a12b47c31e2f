// Convolution and both adjoints for GPU-class devices: implicit matrix products C = A B, no im2col in memory. A group of
// SIDE x SIDE lanes computes TM x TN results from strips of TK of the depth staged in local memory; a lane owns every
// SIDE-th row and column of them. All three passes are
//   c[i][j] += a[i][k] * image[place(j) + place(k)]
// where j and k run over pixels and taps: forward j = (n, p, q), k = (c, r, s); adjoint in x the same with taps taken
// away and places divided by the stride; adjoint in w j = (c, r, s), k = (n, p, q).
//: variant conv2d_tiled gpu any LANES=256 TM=64 TN=64 TK=16
//: variant conv2d_tiled gpu any LANES=64 TM=32 TN=32 TK=16
// narrow: C has 32 rows or fewer (the channels of an image decoder), of which a tile of 64 would leave half unused.
//: variant conv2d_tiled gpu narrow LANES=256 TM=32 TN=128 TK=16
//: variant conv2d_tiled gpu narrow LANES=64 TM=32 TN=64 TK=16
//: variant conv2d_tiled gpu narrow LANES=64 TM=32 TN=32 TK=16
#define SIDE (LANES == 64 ? 8 : 16)
#define RM (TM / SIDE)
#define RN (TN / SIDE)
#define A_PITCH (TM + 1)  // an odd pitch: lanes that stage along the depth write to different banks

// Split of an index: `inner` of them have the inner step 1, then `outer` is gone on.
typedef struct {
  int inner, outer;
} Split;
static inline long place_in(int i, Split s) { return (long)(i / s.inner) * s.outer + i % s.inner; }

// Indices that run over pixels (n, p, q): p * step + first is a row of the image; over taps (c, r, s): r * step. A step
// below 0 takes taps away.
typedef struct {
  int columns, plane, step, first, outer;
} Walk;
static inline int4 walk_to(int i, Walk w) {
  const int high = i / w.plane, low = i - high * w.plane, row = low / w.columns;
  return (int4)(high * w.outer, row * w.step + w.first, (low - row * w.columns) * w.step + w.first, 0);
}
// The same for the depth; w: where a's element lies in its row.
static inline int4 step_to(int k, int end, Walk w, Split a) {
  const int4 place = walk_to(min(k, end - 1), w);
  return (int4)(place.xyz, (int)place_in(min(k, end - 1), a));
}

// HALF: the image lies in half precision; sums are of floats all the same.
#if HALF
typedef half pixel;
#define READ_PIXEL(image, at) vload_half(at, image)
#else
typedef float pixel;
#define READ_PIXEL(image, at) (image)[at]
#endif

// The image [.., height, width] at the sum of two places; zero outside, and where `spread` does not divide.
static inline float image_at(__global const pixel* restrict image, int4 a, int4 b, int height, int width, int spread) {
  const int y = a.y + b.y, x = a.z + b.z;
  if (y < 0 || x < 0) return 0.0f;
  const int row = spread == 1 ? y : y / spread, column = spread == 1 ? x : x / spread;
  if (row * spread != y || column * spread != x || row >= height || column >= width) return 0.0f;
  return READ_PIXEL(image, a.x + b.x + row * width + column);
}

// Group (j, i, z): tile (i, j) of C; z = group * splits + split. A split sums k_each of the depth into its own part of c.
__attribute__((reqd_work_group_size(SIDE, SIDE, 1))) __kernel void conv2d_tiled(
    __global const float* restrict a, __global const pixel* restrict image, __global float* restrict c,
    __global const float* restrict bias, __global const float* restrict residual, int m, int n, int depth, int a_row,
    int a_inner, int a_outer, int a_group, int image_group, int height, int width, int spread, int j_columns,
    int j_plane, int j_step, int j_first, int j_outer, int k_columns, int k_plane, int k_step, int k_first, int k_outer,
    int c_row, int c_inner, int c_outer, int c_group, int c_split, int splits, int k_each, int bias_step,
    int epilogue) {
  __local float a_strip[TK * A_PITCH], b_strip[TK * TN];
  __local int4 places[TK];
  const int x = get_local_id(0), y = get_local_id(1), lane = y * SIDE + x;
  const int i0 = get_group_id(1) * TM, j0 = get_group_id(0) * TN;
  const int group = get_group_id(2) / splits, split = get_group_id(2) - group * splits;
  const int begin = split * k_each, end = min(depth, begin + k_each);
  const Split a_split = {a_inner, a_outer}, c_places = {c_inner, c_outer};
  const Walk walk_j = {j_columns, j_plane, j_step, j_first, j_outer};
  const Walk walk_k = {k_columns, k_plane, k_step, k_first, k_outer};
  a += (size_t)group * a_group;
  image += (size_t)group * image_group;
  const int4 column = walk_to(min(j0 + lane % TN, n - 1), walk_j);  // the column of B that this lane stages
  float acc[RM][RN];
  UNROLL for (int i = 0; i < RM; i++) UNROLL for (int j = 0; j < RN; j++) acc[i][j] = 0.0f;
  if (lane < TK) places[lane] = step_to(begin + lane, end, walk_k, a_split);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int k0 = begin; k0 < end; k0 += TK) {
    for (int e = lane; e < TK * TM; e += LANES) {
      const int k = e % TK, i = e / TK;
      a_strip[k * A_PITCH + i] = i0 + i < m && k0 + k < end ? a[(long)(i0 + i) * a_row + places[k].w] : 0.0f;
    }
    for (int k = lane / TN; k < TK; k += LANES / TN)
      b_strip[k * TN + lane % TN] =
          k0 + k < end && j0 + lane % TN < n ? image_at(image, column, places[k], height, width, spread) : 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane < TK) places[lane] = step_to(k0 + TK + lane, end, walk_k, a_split);
    for (int k = 0; k < TK; k++) {
      float of_a[RM], of_b[RN];
      UNROLL for (int i = 0; i < RM; i++) of_a[i] = a_strip[k * A_PITCH + i * SIDE + y];
      UNROLL for (int j = 0; j < RN; j++) of_b[j] = b_strip[k * TN + j * SIDE + x];
      UNROLL for (int i = 0; i < RM; i++) UNROLL for (int j = 0; j < RN; j++) acc[i][j] += of_a[i] * of_b[j];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  UNROLL for (int i = 0; i < RM; i++) UNROLL for (int j = 0; j < RN; j++) {
    const int row = i0 + i * SIDE + y, at_column = j0 + j * SIDE + x;
    if (row < m && at_column < n) {
      const long to = (long)group * c_group + (long)row * c_row + place_in(at_column, c_places);
      float sum = acc[i][j];
      if (epilogue & EPILOGUE_BIAS) sum += bias[at_column / c_inner * bias_step + group * m + row];
      if (epilogue & EPILOGUE_RESIDUAL) sum += residual[to];
      c[(long)split * c_split + to] = activate(sum, epilogue);
    }
  }
}

// c[e] = sum over s of parts[s][e], in the order of s.
__kernel void add_parts(__global const float* restrict parts, __global float* restrict c, int count, int splits) {
  const int e = get_global_id(0);
  if (e >= count) return;
  float sum = parts[e];
  for (int s = 1; s < splits; s++) sum += parts[(long)s * count + e];
  c[e] = sum;
}
