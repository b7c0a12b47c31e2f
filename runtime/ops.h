// The ops that everything is made of: signature, meaning, shapes (others: runtime/ops/*.h). Letters: N batch, C
// channels, H W, K out channels, R rays, S samples, L rows. Operands of pointwise ops broadcast as in NumPy. Shape
// errors name the op, the shapes and what was wanted.
#pragma once
#include "runtime/tensor.h"

namespace cloam {

// ---- Pointwise (ops/pointwise.cpp). Integer operands stay integers where C would keep them; comparisons give int32
// 0/1.
Tensor operator+(const Tensor& a, const Tensor& b);
Tensor operator-(const Tensor& a, const Tensor& b);
Tensor operator*(const Tensor& a, const Tensor& b);
Tensor operator/(const Tensor& a, const Tensor& b);
Tensor operator-(const Tensor& x);
Tensor operator<(const Tensor& a, const Tensor& b);
Tensor operator>(const Tensor& a, const Tensor& b);
Tensor operator<=(const Tensor& a, const Tensor& b);
Tensor equal(const Tensor& a, const Tensor& b);
Tensor minimum(const Tensor& a, const Tensor& b);  // at ties the gradient goes to b
Tensor maximum(const Tensor& a, const Tensor& b);  // at ties the gradient goes to b
Tensor pow(const Tensor& a, const Tensor& b);      // a >= 0
Tensor atan2(const Tensor& a, const Tensor& b);
Tensor modulo(const Tensor& a, const Tensor& b);   // integers, C's remainder
Tensor bit_xor(const Tensor& a, const Tensor& b);  // integers
Tensor abs(const Tensor& x);
Tensor sign(const Tensor& x);   // no gradient
Tensor floor(const Tensor& x);  // no gradient
Tensor square(const Tensor& x);
Tensor sqrt(const Tensor& x);
Tensor rsqrt(const Tensor& x);
Tensor exp(const Tensor& x);
Tensor log(const Tensor& x);
Tensor sin(const Tensor& x);  // |x| < 8192
Tensor cos(const Tensor& x);
Tensor tanh(const Tensor& x);
Tensor erf(const Tensor& x);
Tensor sigmoid(const Tensor& x);
Tensor softplus(const Tensor& x);
Tensor silu(const Tensor& x);
Tensor relu(const Tensor& x);  // of float16 in float16
Tensor leaky_relu(const Tensor& x, float slope);
Tensor gelu(const Tensor& x);  // x * Phi(x)
Tensor clamp(const Tensor& x, const Tensor& low, const Tensor& high);
Tensor where(const Tensor& condition, const Tensor& yes, const Tensor& no);  // condition: an integer mask
Tensor cast(const Tensor& x, DType dtype);                                   // float to integer truncates
Tensor stop_gradient(const Tensor& x);

// ---- Views (ops/view.cpp): no copy where strides allow.
Tensor reshape(const Tensor& x, const Shape& shape);  // one extent may be -1
Tensor permute(const Tensor& x, const Shape& axes);
Tensor transpose(const Tensor& x, int axis_a = -1, int axis_b = -2);
Tensor slice(const Tensor& x, int axis, int64_t begin, int64_t end, int64_t step = 1);
Tensor broadcast_to(const Tensor& x, const Shape& shape);
Tensor unsqueeze(const Tensor& x, int axis);   // a new axis of size 1 before `axis` (-1: last)
Tensor bitcast(const Tensor& x, DType dtype);  // same bytes, dtype of equal size

// ---- New leaves.
Tensor full(const Shape& shape, float value);
Tensor zeros(const Shape& shape);
Tensor ones(const Shape& shape);

// ---- Reductions (ops/reduce.cpp): over `axes` (empty: all). One fixed order of summation a device class.
struct Reduce {
  std::vector<int> axes = {};
  bool keep = false;  // keep reduced axes with size 1
};
Tensor sum(const Tensor& x, const Reduce& over = {});
Tensor mean(const Tensor& x, const Reduce& over = {});
Tensor max(const Tensor& x, const Reduce& over = {});  // the gradient is shared among ties
Tensor min(const Tensor& x, const Reduce& over = {});
Tensor sum_to(const Tensor& x, const Shape& shape);  // transpose of broadcast_to

// ---- Joining (ops/join.cpp).
Tensor concat(const Tensors& parts, int axis);
Tensors split(const Tensor& x, int axis, const std::vector<int64_t>& sizes);
Tensor pad(const Tensor& x, int axis, int64_t before, int64_t after);  // zeros

// ---- Random numbers (ops/random.cpp): counter-based Philox4x32-10. Element i depends on (key, i) alone; bits, uniform
// and below are the same on every device, normal up to the rounding of its sqrt.
struct RandomKey {
  uint64_t seed = 0;
  uint32_t step = 0;    // of training
  uint32_t stream = 0;  // one for every use within a step
  RandomKey of_stream(uint32_t which) const { return {seed, step, which}; }
};
Tensor random_bits(const Shape& shape, const RandomKey& key, uint64_t first_block = 0);  // uint32; a block is 4 numbers
Tensor random_uniform(const Shape& shape, const RandomKey& key);                         // [0,1), multiples of 2^-24
Tensor random_normal(const Shape& shape, const RandomKey& key);            // mean 0, deviation 1, |z| < 5.8
Tensor random_below(const Shape& shape, int64_t n, const RandomKey& key);  // int32 in [0,n), bias < n / 2^32

// ---- Running sums (ops/scan.cpp).
struct Cumulative {
  bool exclusive = false;  // element i leaves out x_i
  bool reverse = false;    // from the end of the axis
};
/// Along one axis, f32 or i32 (which wraps); keeps shape and dtype.
Tensor cumsum(const Tensor& x, int axis, const Cumulative& how = {});

// ---- Dense (ops/matmul.cpp, ops/conv2d.cpp). float32; the x of conv2d and conv2d_dw may be float16. Sums are float32.
/// a [..,M,K] x b [..,K,N] -> [..,M,N]; batch axes broadcast. Transposed operands are transpose() views: no copy.
Tensor matmul(const Tensor& a, const Tensor& b);
enum class Activation { none, relu, silu };
/// What is done to a finished sum before it is stored: activation(sum + bias + residual).
struct Epilogue {
  Tensor bias = {};      // linear: [N]; conv2d: [K], or [N,K] for one of each image
  Tensor residual = {};  // of the result's shape
  Activation activation = Activation::none;
};
/// activation(x w + bias + residual): x [..,K], w [K,N] -> [..,N]; one launch, linear_composed is its reference.
Tensor linear(const Tensor& x, const Tensor& w, const Epilogue& with = {});
Tensor linear_composed(const Tensor& x, const Tensor& w, const Epilogue& with = {});
struct Conv2dParams {
  int stride = 1, pad = 0, groups = 1;  // pad: zeros on every side
};
/// x [N,C,H,W], w [K,C/groups,R,S] -> [N,K,P,Q] with P = (H + 2 pad - R) / stride + 1, rounded down; the epilogue is
/// part of the launch, conv2d_composed is its reference.
/// y[n,k,p,q] = sum of x[n,c,p*stride+r-pad,q*stride+s-pad] * w[k,c,r,s]: the correlation that networks call
/// convolution.
Tensor conv2d(const Tensor& x, const Tensor& w, Conv2dParams params = {}, const Epilogue& with = {});
Tensor conv2d_composed(const Tensor& x, const Tensor& w, Conv2dParams params = {}, const Epilogue& with = {});
/// Its adjoints, the gradients by name: in x (also known as transposed convolution), from y [N,K,P,Q] and w; in w, from
/// x and y. The shape wanted is named because several have the same y when the stride does not divide.
Tensor conv2d_dx(const Tensor& y, const Tensor& w, const Shape& x_shape, Conv2dParams params = {});
Tensor conv2d_dw(const Tensor& x, const Tensor& y, const Shape& w_shape, Conv2dParams params = {});
/// Windows over images, places as in a convolution.
struct Window {
  int64_t height, width;
  int stride = 1, pad = 0;  // pad: zeros on every side
  int64_t places(int64_t size, int64_t taps) const { return (size + 2 * pad - taps) / stride + 1; }
};
/// What each tap of a window sees of images x [A,B,H,W,N] -> [A,height*width,B,P,Q,N]. With channels as A and the batch
/// as N, the rows are those that weights [K, C*height*width] multiply in a convolution (ops/unfold.cpp).
Tensor unfold(const Tensor& x, const Window& window);
/// The adjoint: every value added to the pixel that it was seen at -> [A,B,height,width,N].
Tensor fold(const Tensor& windows, const Window& window, int64_t height, int64_t width);
struct Pooling {
  int window = 2, stride = 2, pad = 0;  // pad: up to half a window that hangs over every side; what is there never wins
  bool ceil = false;                    // windows that the last row or column begins are cut, else left out
  int64_t places(int64_t size) const;
};
/// The largest value of each window (ops/max_pool.cpp): x [N,C,H,W] -> [N,C,places(H),places(W)]. Of equal ones the
/// first, row by row, gets the gradient.
Tensor max_pool2d(const Tensor& x, const Pooling& with = {});

// ---- Normalisation and attention (ops/norm.cpp, ops/attention.cpp): any number of times differentiable.
Tensor softmax(const Tensor& x, int axis);
Tensor log_softmax(const Tensor& x, int axis);
/// x [..., C], gamma and beta [C]: mean 0 and variance 1 over the last axis, then scaled and shifted.
Tensor layer_norm(const Tensor& x, const Tensor& gamma, const Tensor& beta, float epsilon = 1e-5f);
struct GroupNormOptions {
  Tensor scale = {}, shift = {};  // [N,C], of a time embedding, say: y * (1 + scale) + shift
  bool silu = false;              // silu() of all that
  float epsilon = 1e-5f;
};
/// x [N,C,...], gamma and beta [C] (either may be an empty handle): the same over each of `groups` runs of channels and
/// all that follows them.
Tensor group_norm(const Tensor& x, int groups, const Tensor& gamma, const Tensor& beta,
                  const GroupNormOptions& with = {});
/// softmax(q k^T scale) v: q [B..,T,D], k [B..,U,D], v [B..,U,E] -> [B..,T,E]; scale 0 is 1/sqrt(D). The scores are
/// never stored.
Tensor attention(const Tensor& q, const Tensor& k, const Tensor& v, float scale = 0.f);

// ---- Resizing (ops/resize.cpp): x [N,C,H,W] -> [N,C,height,width], any factor. Half-pixel centres
// (align_corners=false), borders go on. Bilinear reads two neighbours an axis however much smaller the result is:
// shrink by pooling first.
Tensor resize_nearest(const Tensor& x, int64_t height, int64_t width);
Tensor resize_bilinear(const Tensor& x, int64_t height, int64_t width);

// ---- Rows by number (ops/index.cpp). Row numbers are int32; one outside the table, below 0 too, counts as its nearest
// row.
/// table [L, ...] of any dtype, rows [...] -> [rows..., ...]: out[i] = table[rows[i]].
Tensor gather_rows(const Tensor& table, const Tensor& rows);
/// values [n, ...] f32, rows [n] -> [count, ...]: out[r] = the sum of values[i] with rows[i] = r, in a fixed order.
Tensor scatter_add_rows(const Tensor& values, const Tensor& rows, int64_t count);

// ---- Sorting (ops/sort.cpp).
struct Sorted {
  Tensor keys, order;  // keys = gather_rows(the keys given, order); order is int32
};
/// Ascending and stable. Keys: u32, i32 or f32 [n] (-0 before 0, every NaN last), or u32 [n,2]: numbers of 64 bits, the
/// low word first. Keys from 0 to 2^bits - 1 need only `bits` bits (0: all): fewer passes. A `payload` int32 [n], for
/// keys of integers, takes the place of 0, 1, 2 ... in `order`. A gradient reaches keys of floats, none the order.
Sorted sort(const Tensor& keys, int bits = 0, const Tensor& payload = {});

// ---- Segments (ops/segments.cpp). Segment l of values [n, ...] is the rows offsets[l] up to offsets[l+1].
/// sorted_ids int32 [n], ascending -> int32 [count+1]: the first place of each id. Ids outside [0,count) get no
/// segment.
Tensor segment_offsets(const Tensor& sorted_ids, int64_t count);
/// values [n, ...] f32, offsets int32 [L+1] ascending -> [L, ...]: the sum of each segment, in a fixed order.
Tensor segment_sum(const Tensor& values, const Tensor& offsets);
/// The transpose: of [L, ...] -> [n, ...], row i is that of i's segment, zero where i is in none.
Tensor segment_spread(const Tensor& of, const Tensor& offsets, int64_t n);

}  // namespace cloam
