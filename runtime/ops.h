// Every op: signature, meaning, shapes. Letters: N batch, C channels, H W, K out channels, R rays, S samples, L rows.
// Operands of pointwise ops broadcast as in NumPy. Shape errors name the op, the shapes and what was wanted.
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
Tensor modulo(const Tensor& a, const Tensor& b);  // integers, C's remainder
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
Tensor relu(const Tensor& x);
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

// ---- Radiance fields (ops/mlp.cpp, ops/grid.cpp, ops/planes.cpp, ops/volume.cpp).
/// x [S,I] through weights[0] [I,W], ReLU, ... weights.back() [W,O] -> [S,O]; no biases. One fused kernel for
/// W in 16, 32 ... 128 and I, O up to 128 (once differentiable); mlp_composed is its reference and has all derivatives.
Tensor mlp(const Tensor& x, const Tensors& weights);
Tensor mlp_composed(const Tensor& x, const Tensors& weights);

/// Multiresolution hash grid (Mueller et al. 2022, section 3). Level l has floor(coarsest * b^l) cells an axis; the
/// last one has `finest`. Levels whose corners fit 2^log2_rows rows are dense, others hashed.
struct HashGrid {
  int levels = 8, features = 4, log2_rows = 16, coarsest = 16, finest = 1024;
};
Shape hash_grid_table_shape(const HashGrid& grid);  // [levels * 2^log2_rows, features]
class HashGridEncoder {
 public:
  explicit HashGridEncoder(const HashGrid& grid);
  /// points [S,3] in [0,1]^3, table as above -> [S, levels * features]; once differentiable in both.
  Tensor operator()(const Tensor& points, const Tensor& table) const;
  HashGrid grid;

 private:
  Tensor levels_;
};

/// Tri-plane features: planes [3,H,W,C] (xy, xz, yz), points [S,3] in [0,1]^3 -> [S,3C]; bilinear, half-pixel centres,
/// border padding; once differentiable in both.
Tensor sample_planes(const Tensor& planes, const Tensor& points);
/// The same for many: planes [3,A,H,W,C], owners [S] int32 in [0,A), whose planes each point reads.
Tensor sample_planes(const Tensor& planes, const Tensor& points, const Tensor& owners);

struct Rays {
  Tensor origins, directions;  // [R,3]; directions of length 1
  Tensor span;                 // [R,2]: near and far distance
};
struct MarchOptions {
  int side = 128;         // occupancy cells an axis
  bool contract = false;  // the unbounded scene folded into [-2,2]^3, else [-1,1]^3 as it is
  int capacity = 1024;    // samples a ray keeps at most
  float min_step = 0.01f, max_step = 1e9f, cone = 0.f;  // dt = clamp(t * cone, min_step, max_step)
  float threshold = 0.f;                                // cells above it are stepped through
  int explore = 0;  // not 0: one empty cell in 64, chosen by this number, is stepped through as well
};
/// Samples of all rays side by side; ray r owns [offsets[r], offsets[r+1]).
struct RaySamples {
  Tensor points;   // [S,3] in [0,1]^3
  Tensor t, dt;    // [S] middle and length of the interval
  Tensor ray;      // [S] int32
  Tensor offsets;  // [R+1] int32
};
/// Stratified steps through the occupied cells. jitter [R] in [0,1) shifts each ray; cells [side^3]: optical thickness
/// of one smallest step. Runs at once (the number of samples is known only then); nothing is differentiable.
RaySamples march(const Rays& rays, const Tensor& jitter, const Tensor& cells, const MarchOptions& options);
/// The samples of each ray up to where its transmittance falls below `least`. Runs at once.
RaySamples visible(const RaySamples& samples, const Tensor& sigma, float least);

struct Volume {
  Tensor sigma;    // [S] density >= 0
  Tensor rgb;      // [S,3]
  Tensor t, dt;    // [S]
  Tensor offsets;  // [R+1] int32
};
/// Front-to-back quadrature (Max 1995; NeRF eq. 3) -> [R,6]: colour, opacity, depth (sum of w |t|), distortion
/// (mip-NeRF 360 eq. 15 over t / (1 + t)). No gradient to t, dt; once differentiable.
Tensor composite(const Volume& volume);
/// The weights T alpha of all samples [S]; no gradient.
Tensor composite_weights(const Tensor& sigma, const Tensor& dt, const Tensor& offsets);
/// NeRF's inverse-CDF sampling: edges [R,n+1], weights [R,n], ascending uniform [R,m] -> merged edges [R,n+1+m]; no
/// gradient.
Tensor importance_edges(const Tensor& edges, const Tensor& weights, const Tensor& uniform);
/// Scene points [S,3] to [0,1]^3, contracted or not (MarchOptions::contract); no gradient.
Tensor unit_points(const Tensor& points, bool contract);
/// Real spherical harmonics of degree 4 of unit directions [S,3] -> [S,16]; no gradient.
Tensor spherical_harmonics(const Tensor& directions);

/// Cells start, start + stride ... of a grid of side^3 (stride prime to side^3), with a jittered point [n,3] in each.
struct OccupancyCells {
  Tensor cells, points;
};
OccupancyCells occupancy_cells(const Tensor& jitter, int side, int64_t start, int64_t stride);
/// values [side^3] at the cells become max(decay * value, density), in place.
void occupancy_merge(Tensor& values, const Tensor& cells, const Tensor& density, float decay);

// ---- Streets (ops/street.cpp; kernels/street.cl has the layouts): a background in voxels, actors in boxes, the sky.
struct StreetGrid {
  Tensor cells;    // u8 [D,H,W]: is there anything
  Tensor blocks;   // u8: the same of blocks of 8^3, counts rounded up
  Tensor numbers;  // [16]: corner (3), voxel size, counts x y z, centre and half sizes (3 each) of what is not
                   // contracted, furthest distance of the sky
};
struct StreetBoxes {
  Tensor first;  // int32 [M+1]: the boxes of moment m are first[m] up to first[m+1]
  Tensor boxes;  // [B,20]: rotation box_from_street (9), centre (3), half sizes (3), 0.5 / half side of the cube of the
                 // owner's planes, owner
};
struct StreetRays {
  Tensor origins, directions;  // [R,3] in the grid's axes, metres; directions of length 1
  Tensor jitter;               // [R,2] in [0,1): shifts of the background's and of actors' steps
  Tensor moments;              // int32 [R]
};
struct StreetSteps {
  float background = 0.3f, actor = 0.05f;  // metres
  int sky = 8;                             // samples behind the grid
  bool shadows = false;                    // also where rays meet the ground below boxes
};
/// Ray r owns places [offsets[r], offsets[r+1]) of t and rows, by distance. Samples lie in two lists: rows below
/// points.dim(0) are of the background, those from there on of actors.
struct StreetSamples {
  Tensor offsets, t, rows;                        // int32 [R+1], [S] (the sky's negative), int32 [S]
  Tensor points, ray;                             // background: [B,3] contracted to [0,1]^3, int32 [B]
  Tensor actor_points, actor_directions, owners;  // [A,3] in [0,1]^3 of the owner's cube, [A,3] in its box, int32 [A]
  Tensor shadow_offsets, shadow_points, shadow_directions, shadow_owners, shadow_t,
      shadow_ray;  // as offsets and actors
};
/// Runs at once (the number of samples is known only then); nothing is differentiable.
StreetSamples street_samples(const StreetRays& rays, const StreetBoxes& boxes, const StreetGrid& grid,
                             const StreetSteps& steps);
/// The samples that light reaches: those of each ray before its transmittance falls below `least`, and its last. alpha
/// [S] by row. At once.
StreetSamples street_lit(const StreetSamples& samples, const Tensor& alpha, float least);
struct StreetBlended {
  Tensor alpha, features;   // [S], [S,C], by row
  Tensor t, rows, offsets;  // of StreetSamples
  Tensor ranges;            // [R]: where a LiDAR saw something, 0: it did not look
  int64_t background = 0;   // rows from here on are of actors
  float near = 0.1f;        // metres around ranges where matter belongs
};
/// Front to back: [R,C+4]: sum of w f, depth (sum of w |t|), opacity without the sky, the sum of w^2 of samples that
/// are not near the range, and the opacity of actors. The last sample takes all light that is left. Once differentiable
/// in alpha and features.
Tensor street_blend(const StreetBlended& blended);
/// int32 [R]: the owner that gives most light of a ray, if more than half, else -1. At once.
Tensor street_owners(const Tensor& alpha, const StreetSamples& samples);

// ---- Gaussian splats (ops/splat.cpp, ops/splat_project.cpp; kernels/splat*.cl have the formulas).
/// 3D gaussians as training changes them, before exp, sigmoid and normalisation.
struct Cloud {
  Tensor means, scales, rotations, opacities;  // [G,3], [G,3], [G,4] (w, x, y, z: world_from_gaussian), [G]
};
/// A pinhole's numbers in pixels, and what is done beside the projection.
struct SplatCamera {
  float fx = 1, fy = 1, cx = 0, cy = 0;
  int64_t height = 0, width = 0;
  float near = 0.2f;         // gaussians whose centre is nearer are not seen
  float blur = 0.3f;         // square pixels, added to each covariance
  bool antialiased = false;  // opacities shrink by what the blur widens (Yu et al. 2024, Mip-Splatting)
};
/// view [3,4]: camera_from_world -> [G,7]: x, y in pixels, conic a, b, c (the inverse covariance (a b; b c)), opacity
/// (0 where it is not seen), depth along the camera's axis. Once differentiable in the cloud and in view.
Tensor splat_project(const Cloud& cloud, const Tensor& view, const SplatCamera& camera);
/// Colours towards an eye [3] from coefficients of spherical harmonics first [G,3] and rest [G,15,3], of degrees up to
/// `degree` (0 to 3): max(0, 0.5 + sum) -> [G,3]. Once differentiable in all tensors.
struct Harmonics {
  Tensor first, rest;
  int degree = 3;
};
Tensor splat_colours(const Harmonics& harmonics, const Tensor& means, const Tensor& eye);

/// What each tile of 16 x 16 pixels blends, front to back. Tiles row by row, those at the right and lower edge cut.
struct SplatTiles {
  Tensor ids;      // [P] int32 in [0,G): the gaussians of all tiles, one tile after another
  Tensor offsets;  // [tiles+1] int32
  Tensor slots;    // [P] int32: place of each pair when they are listed by gaussian
  Tensor first;    // [G+1] int32: where each gaussian's begin there
  int64_t height, width;
};
/// From the projection [G,7]: by tile, depth and number, each gaussian in the tiles where its alpha reaches 1/255. Runs
/// at once (the number of pairs is known only then); nothing is differentiable. Fault::usage for more than 2^31 pairs.
SplatTiles splat_tiles(const Tensor& seen, int64_t height, int64_t width);
struct SplatExtent {
  int64_t gaussians, height, width;
};
/// Lists that were made otherwise.
SplatTiles splat_lists(const Tensor& ids, const Tensor& offsets, const SplatExtent& extent);

struct Splats {
  Tensor seen;        // [G,7] of splat_project; the centre of the first pixel is (0.5, 0.5)
  Tensor colours;     // [G,C]: colours, depths, features
  Tensor probe = {};  // [G,2], never read: its gradient is the sum over pixels of |d loss / d x|, |d loss / d y|
};
struct Blended {
  Tensor image;          // [H,W,C]
  Tensor transmittance;  // [H,W]: what of the background is seen
};
/// 3D Gaussian Splatting's blending (Kerbl et al. 2023). Once differentiable in the splats; the gradients are the same
/// bits each time. Three channels a pass.
Blended splat_blend(const Splats& splats, const SplatTiles& tiles);

// ---- Pictures compared (ops/ssim.cpp).
/// Means over all values, scalars. With y a photograph, Gaussian splatting's loss is 0.8 l1 + 0.2 (1 - ssim).
struct Likeness {
  Tensor l1;    // of |x - y|
  Tensor ssim;  // Wang et al. 2004: Gaussian window of 11 x 11 with sigma 1.5, zeros around the picture, values up to 1
};
/// x, y [C,H,W]. Once differentiable in x, no gradient to y. What a mask leaves out the caller makes black in both.
Likeness likeness(const Tensor& x, const Tensor& y);

// ---- Random numbers (ops/random.cpp): counter-based Philox4x32-10. Element i depends on (key, i) alone; bits, uniform
// and below are the same on every device, normal up to the rounding of its sqrt.
struct RandomKey {
  uint64_t seed = 0;
  uint32_t step = 0;    // of training
  uint32_t stream = 0;  // one for every use within a step
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

// ---- Dense (ops/matmul.cpp, ops/conv2d.cpp). float32.
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
Tensor embedding(const Tensor& table, const Tensor& ids);  // gather_rows under its other name
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

// ---- The optimiser's step (ops/adam.cpp): at once, in place, seen through every handle. No graph ops.
struct AdamStep {
  float learning_rate = 1e-3f, beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-8f;
  float weight_decay = 0;  // decoupled, as AdamW: the parameter shrinks by learning_rate * weight_decay
  int64_t step = 1;        // from 1
};
/// parameter, m, v: leaves of one shape, none sharing values with another (m and v begin as zeros(shape)). A pending
/// gradient is evaluated: where there are many, eval() all of them together first.
void adam_step(Tensor& parameter, Tensor& m, Tensor& v, const Tensor& gradient, const AdamStep& with);
/// The same for parameter [L, ...] of which few rows are in use: a row whose gradient is all zero stays as it is, each
/// other counts its own steps in row_steps int32 [L] (with.step is not read).
void adam_step_rows(Tensor& parameter, Tensor& m, Tensor& v, Tensor& row_steps, const Tensor& gradient,
                    const AdamStep& with);

}  // namespace cloam
