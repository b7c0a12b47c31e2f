// Tri-plane sampling and its adjoints (EG3D, Chan et al. 2022, section 4.1; yz as the third plane).
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const Registered kRegistered("sample_planes");

struct Once : Op {
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("sample_planes", "it is once differentiable; use finite differences of the field for normals");
  }
};

/// in: points, g; out: [3,H,W,C].
struct SamplePlanesGrad final : Once {
  const char* name() const override { return "sample_planes_dplanes"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t n = in[0].dim(0), height = out.dim(1), width = out.dim(2), channels = out.dim(3);
    if (is_cpu_class() && !reference_variants()) {
      const int64_t strips = std::clamp<int64_t>(2 * device().compute_units / 3 + 1, 1, height);
      launch(kernel("planes", name()), name(), range1(3 * strips), in[0], in[1], out, n, height, width, channels,
             strips);
      return;
    }
    const Tensor rows = empty({n * 12}, DType::i32), values = empty({n * 12, channels});
    launch(kernel("planes", "sample_planes_pairs"), "sample_planes_pairs", elements(n * 3), in[0], in[1], rows, values,
           n, height, width, channels);
    const Tensor sums = reshape(scatter_add_rows(values, rows, 3 * height * width), out.shape());
    eval({sums});
    out.node()->storage = dense(sums).node()->storage;
  }
};

/// in: planes, points, g; out: [S,3].
struct SamplePlanesGradPoints final : Once {
  const char* name() const override { return "sample_planes_dpoints"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 512);
    launch(kernel("planes", name()), name(), range, in[0], in[1], in[2], out, out.dim(0), in[0].dim(1), in[0].dim(2),
           in[0].dim(3), chunk);
  }
};

struct SamplePlanes final : Op {
  const char* name() const override { return "sample_planes"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 512);
    launch(kernel("planes", name()), name(), range, in[0], in[1], out, out.dim(0), in[0].dim(1), in[0].dim(2),
           in[0].dim(3), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {make(std::make_shared<SamplePlanesGrad>(), in[0].shape(), {in[1], g}),
            make(std::make_shared<SamplePlanesGradPoints>(), in[1].shape(), {in[0], in[1], g})};
  }
};

}  // namespace

Tensor sample_planes(const Tensor& planes, const Tensor& points) {
  const Dims d = match("sample_planes", {{"planes", planes, "3 H W C"}, {"points", points, "S 3"}});
  return make(std::make_shared<SamplePlanes>(), {d["S"], 3 * d["C"]}, {planes, points});
}

}  // namespace cloam
