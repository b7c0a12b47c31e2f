// Two pictures compared: mean difference and structural similarity, with the gradient in the first of them.
#include "runtime/ops/ssim.h"

#include <cmath>
#include <numeric>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kSsimKernels("ssim");

/// Pictures narrower than a vector take the reference.
const Variant& variant_for(const Tensor& x) { return choose("ssim", x.dim(2) >= 16 ? "wide" : "narrow"); }

/// How a picture is shared out on CPU devices: blocks of rows of tiles, which are as equal as whole vectors allow.
struct Pieces {
  Pieces(const Variant& v, const Shape& picture) {
    const int64_t vectors = (picture[2] + 15) / 16, tiles = (vectors + v["TILE"] - 1) / v["TILE"];
    tile = (vectors + tiles - 1) / tiles;
    count = picture[0] * ((picture[1] + v["ROWS"] - 1) / v["ROWS"]) * ((vectors + tile - 1) / tile);
    work = share(count, 1);
  }
  int64_t tile = 1, count = 0;
  WorkShare work;
};

/// On other devices: a value a work-item, in the GPU variant in groups that are tiles.
Range tiled_range(const Variant& v, const Shape& picture) {
  if (v.where == "reference") return elements(numel(picture));
  const int64_t side = v["SIDE"], lanes = v["LANES"];
  return range1(picture[0] * ((picture[1] + side - 1) / side) * ((picture[2] + side - 1) / side) * lanes, lanes);
}

/// in: x, y [C,H,W] -> [2]: the sums of |x - y| and of 1 - SSIM.
struct Ssim final : Op {
  const char* name() const override { return "ssim"; }
  void run(const Tensors& in, Tensor& out) const override { maps = compare(in, out, out.tracked()); }
  Tensor compare(const Tensors& in, Tensor& out, bool keep) const;
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override;
  mutable Tensor maps;  // for the gradient, which takes it; computed again if it comes twice
};

/// Gives the maps that the gradient needs, if they are to be kept.
Tensor Ssim::compare(const Tensors& in, Tensor& out, bool keep) const {
  const Shape& picture = in[0].shape();
  const Variant& v = variant_for(in[0]);
  const Tensor saved = empty({keep ? 3 * in[0].numel() : 1});
  Tensor parts;  // of the sums
  if (v.where == "cpu") {
    const Pieces pieces(v, picture);
    parts = empty({2, static_cast<int64_t>(pieces.work.range.global[0])});
    launch(kernel(v), name(), pieces.work.range, in[0], in[1], parts, saved, pieces.count, picture[1], picture[2],
           pieces.tile, keep ? 1 : 0, pieces.work.chunk);
  } else {
    const Range range = tiled_range(v, picture);
    const auto groups = static_cast<int64_t>(range.global[0] / range.local[0]);
    parts = empty({2, v.where == "gpu" ? groups : in[0].numel()});
    launch(kernel(v), name(), range, in[0], in[1], parts, saved, in[0].numel(), picture[1], picture[2], keep ? 1 : 0);
  }
  const Tensor sums = sum(parts, {{1}});
  adopt(out, sums);
  return keep ? saved : Tensor();
}

Tensor sums_composed(const Tensors& in);

/// in: x, y, the weights [2] of the two sums, the sums -> the gradient in x. The sums are there so that their
/// evaluation, which saves the maps, comes first.
struct SsimGrad final : Op {
  explicit SsimGrad(std::shared_ptr<const Ssim> op) : forward(std::move(op)) {}
  const char* name() const override { return "ssim_grad"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto gradient = [](const Tensors& of) { return vjp_of(sums_composed, {of[0], of[1]}, of[2])[0]; };
    return vjp_of(gradient, in, g);
  }
  std::shared_ptr<const Ssim> forward;
};

void SsimGrad::run(const Tensors& in, Tensor& out) const {
  Tensor maps = std::move(forward->maps);
  forward->maps = {};
  if (!maps) {
    Tensor unused = empty({2});
    maps = forward->compare(in, unused, true);
  }
  const Shape& picture = out.shape();
  const Variant& v = variant_for(out);
  cl::Kernel& k = kernel(v, (v.kernel + "_grad").c_str());
  if (v.where == "cpu") {
    const Pieces pieces(v, picture);
    launch(k, name(), pieces.work.range, in[0], in[1], maps, in[2], out, pieces.count, picture[1], picture[2],
           pieces.tile, pieces.work.chunk);
  } else {
    launch(k, name(), tiled_range(v, picture), in[0], in[1], maps, in[2], out, out.numel(), picture[1], picture[2]);
  }
}

Tensors Ssim::vjp(const Tensors& in, const Tensor& out, const Tensor& g) const {
  // The gradient keeps this very op alive, and with it the maps of this very evaluation.
  const auto self = std::static_pointer_cast<const Ssim>(shared());
  return {make(std::make_shared<SsimGrad>(self), in[0].shape(), {in[0], in[1], g, out}), Tensor()};
}

/// The mean over the window around each value of [C,H,W].
Tensor window_mean(const Tensor& x) {
  constexpr int kReach = 5, kSide = 2 * kReach + 1;
  std::vector<float> line, square;
  for (int i = -kReach; i <= kReach; i++) line.push_back(std::exp(static_cast<float>(-i * i) / 4.5f));
  const float whole = std::accumulate(line.begin(), line.end(), 0.f);
  for (float row : line)
    for (float column : line) square.push_back(row * column / (whole * whole));
  return reshape(conv2d(unsqueeze(x, 1), from_host(square, {1, 1, kSide, kSide}), {.pad = kReach}), x.shape());
}

/// in: x, y -> [2]. The names are those of kernels/ssim.cl.
Tensor sums_composed(const Tensors& in) {
  const Tensor y = stop_gradient(in[1]), u = in[0] + y, v = in[0] - y;
  const Tensor uu = square(window_mean(u)), vv = square(window_mean(v));
  const Tensor su = window_mean(square(u)) - uu, sv = window_mean(square(v)) - vv;
  const Tensor p = 2.f * vv / (uu + vv + 2e-4f), q = 2.f * sv / (su + sv + 1.8e-3f);
  return concat({reshape(sum(v * sign(v)), {1}), reshape(sum(p + q - p * q), {1})}, 0);
}

void check_pictures(const Tensor& x, const Tensor& y) {
  match("likeness", {{"x", x, "C H W"}, {"y", y, "C H W"}});
  if (x.dtype() != DType::f32 || y.dtype() != DType::f32 || x.numel() == 0)
    throw Error(Fault::internal, text("[likeness] ", to_string(x.shape()), " of ", name_of(x.dtype()), " and ",
                                      name_of(y.dtype()), ": want pictures of float32 with a pixel at least"));
}

/// Of the sums over all values.
Likeness means_of(const Tensor& sums, int64_t count) {
  const auto mean = [&](int64_t which) {
    return reshape(slice(sums, 0, which, which + 1), {}) * (1.f / static_cast<float>(count));
  };
  return {mean(0), 1.f - mean(1)};
}

}  // namespace

Likeness likeness(const Tensor& x, const Tensor& y) {
  check_pictures(x, y);
  return means_of(make(std::make_shared<Ssim>(), {2}, {x, y}), x.numel());
}

Likeness likeness_composed(const Tensor& x, const Tensor& y) {
  check_pictures(x, y);
  return means_of(sums_composed({x, y}), x.numel());
}

}  // namespace cloam
