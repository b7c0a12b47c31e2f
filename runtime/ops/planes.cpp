// Tri-plane sampling and its adjoints (EG3D, Chan et al. 2022, section 4.1; yz as the third plane).
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/scan.h"

namespace cloam {
namespace {

const Registered kRegistered("sample_planes");

struct Once : Op {
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("sample_planes", "it is once differentiable; use finite differences of the field for normals");
  }
};

/// Vectors: whole rows of them, and coordinates of 15 bits.
const Variant& variant_for(const Shape& planes) {
  const bool vectors = planes[3] % 16 == 0 && std::max(planes[1], planes[2]) < 32768;
  return choose("planes", vectors ? "vectors" : "any");
}

cl::Kernel& vectors_kernel(const Variant& v, const char* name, int64_t channels) {
  Constants all = v.constants;
  all.push_back({"VECTORS", static_cast<int>(channels / 16)});
  return kernel(v.stem.c_str(), name, all);
}

/// in: points, g; out: [3,H,W,C].
struct SamplePlanesGrad final : Once {
  const char* name() const override { return "sample_planes_dplanes"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = variant_for(out.shape());
    v.where == "cpu" ? by_bands(v, in, out) : by_pairs(in, out);
  }
  static void by_pairs(const Tensors& in, Tensor& out);
  static void by_bands(const Variant& v, const Tensors& in, const Tensor& out);
};

void SamplePlanesGrad::by_pairs(const Tensors& in, Tensor& out) {
  const int64_t n = in[0].dim(0), height = out.dim(1), width = out.dim(2), channels = out.dim(3);
  const Tensor rows = empty({n * 12}, DType::i32), values = empty({n * 12, channels});
  launch(kernel("planes", "sample_planes_pairs"), "sample_planes_pairs", elements(n * 3), in[0], in[1], rows, values, n,
         height, width, channels);
  const Tensor sums = reshape(scatter_add_rows(values, rows, 3 * height * width), out.shape());
  eval({sums});
  out.node()->storage = dense(sums).node()->storage;
}

void SamplePlanesGrad::by_bands(const Variant& v, const Tensors& in, const Tensor& out) {
  const int64_t n = in[0].dim(0), height = out.dim(1), width = out.dim(2), channels = out.dim(3),
                bands = (height + v["BAND"] - 1) / v["BAND"];
  const int64_t chunk = std::max<int64_t>(1024, (n + 31) / 32), chunks = std::max<int64_t>(1, (n + chunk - 1) / chunk);
  const Tensor counts = empty({3 * bands * chunks}, DType::i32), starts = empty(counts.shape(), DType::i32);
  const Tensor list = empty({std::max<int64_t>(1, 6 * n), 4}, DType::i32);
  launch(vectors_kernel(v, "planes_count", channels), "planes_count", range2(chunks, 3), in[0], counts, n, height,
         chunks, chunk);
  scan_rows(counts, starts, 1, {.exclusive = true});
  launch(vectors_kernel(v, "planes_list", channels), "planes_list", range2(chunks, 3), in[0], starts, list, n, height,
         width, chunks, chunk);
  launch(vectors_kernel(v, "planes_add", channels), "planes_add", range2(bands, 3), in[1], list, starts, out, height,
         width, chunks);
}

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
    const int64_t n = out.dim(0), height = in[0].dim(1), width = in[0].dim(2), channels = in[0].dim(3);
    const Variant& v = variant_for(in[0].shape());
    auto [range, chunk] = chunks(n, 512);
    if (v.where != "cpu") {
      launch(kernel(v), name(), range, in[0], in[1], out, n, height, width, channels, chunk);
      return;
    }
    range.global[1] = 3;
    launch(vectors_kernel(v, "sample_planes_vectors", channels), name(), range, in[0], in[1], out, n, height, width,
           chunk);
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
