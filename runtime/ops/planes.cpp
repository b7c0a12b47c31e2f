// Tri-plane sampling and its adjoints (EG3D, Chan et al. 2022, section 4.1; yz as the third plane).
#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/scan.h"

namespace cloam {
namespace {

const Registered kRegistered("sample_planes");

struct Once : Op {
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override {
    no_gradient("sample_planes", "it is once differentiable; use finite differences of the field for normals");
  }
};

/// Planes [3,A,H,W,C] as the kernels see them.
struct Layout {
  explicit Layout(const Shape& planes)
      : rows(planes[1] * planes[2]), height(planes[2]), width(planes[3]), channels(planes[4]) {}
  int64_t rows, height, width, channels;
};

/// Vectors: whole rows of them, and coordinates of 15 bits.
const Variant& variant_for(const Layout& p) {
  const bool vectors = p.channels % 4 == 0 && p.channels <= 256 && std::max(p.rows, p.width) < 32768;
  return choose("planes", vectors ? "vectors" : "any");
}

cl::Kernel& vectors_kernel(const Variant& v, const char* name, int64_t channels) {
  Constants all = v.constants;
  const int lanes = channels % 16 == 0 ? 16 : 4;
  all.push_back({"LANES", lanes});
  all.push_back({"VECTORS", static_cast<int>(channels / lanes)});
  return kernel(v.stem.c_str(), name, all);
}

/// Inputs are planes, points and, with several owners, the owner of each point.
int owned(const Tensor& owners) { return owners ? 1 : 0; }
/// A buffer for the argument that is not read.
const Tensor& owners_or(const Tensor& owners, const Tensor& any) { return owners ? owners : any; }

/// in: points, g, perhaps owners; out: [3,A,H,W,C].
struct SamplePlanesGrad final : Once {
  const char* name() const override { return "sample_planes_dplanes"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = variant_for(Layout(out.shape()));
    v.where == "cpu" ? by_bands(v, in, out) : by_pairs(in, out);
  }
  static void by_pairs(const Tensors& in, Tensor& out);
  static void by_bands(const Variant& v, const Tensors& in, const Tensor& out);
};

void SamplePlanesGrad::by_pairs(const Tensors& in, Tensor& out) {
  const int64_t n = in[0].dim(0);
  const Layout p(out.shape());
  const Tensor owners = in.size() > 2 ? in[2] : Tensor();
  const Tensor rows = empty({n * 12}, DType::i32), values = empty({n * 12, p.channels});
  launch(kernel("planes", "sample_planes_pairs"), "sample_planes_pairs", elements(n * 3), in[0],
         owners_or(owners, in[0]), in[1], rows, values, n, owned(owners), p.rows, p.height, p.width, p.channels);
  const Tensor sums = reshape(scatter_add_rows(values, rows, 3 * p.rows * p.width), out.shape());
  eval({sums});
  out.node()->storage = dense(sums).node()->storage;
}

void SamplePlanesGrad::by_bands(const Variant& v, const Tensors& in, const Tensor& out) {
  const Layout p(out.shape());
  const Tensor owners = in.size() > 2 ? in[2] : Tensor(), any = owners_or(owners, in[0]);
  const int64_t n = in[0].dim(0), bands = (p.rows + v["BAND"] - 1) / v["BAND"];
  const int64_t chunk = std::max<int64_t>(1024, (n + 31) / 32), chunks = std::max<int64_t>(1, (n + chunk - 1) / chunk);
  const Tensor counts = empty({3 * bands * chunks}, DType::i32), starts = empty(counts.shape(), DType::i32);
  const Tensor list = empty({std::max<int64_t>(1, 6 * n), 4}, DType::i32);
  launch(vectors_kernel(v, "planes_count", p.channels), "planes_count", range2(chunks, 3), in[0], any, counts, n,
         owned(owners), p.rows, p.height, chunks, chunk);
  scan_rows(counts, starts, 1, {.exclusive = true});
  launch(vectors_kernel(v, "planes_list", p.channels), "planes_list", range2(chunks, 3), in[0], any, starts, list, n,
         owned(owners), p.rows, p.height, p.width, chunks, chunk);
  launch(vectors_kernel(v, "planes_add", p.channels), "planes_add", range2(bands, 3), in[1], list, starts, out, p.rows,
         p.height, p.width, chunks);
}

/// in: planes, points, g, perhaps owners; out: [S,3].
struct SamplePlanesGradPoints final : Once {
  const char* name() const override { return "sample_planes_dpoints"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 512);
    const Layout p(in[0].shape());
    const Tensor owners = in.size() > 3 ? in[3] : Tensor();
    launch(kernel("planes", name()), name(), range, in[0], in[1], owners_or(owners, in[1]), in[2], out, out.dim(0),
           owned(owners), p.rows, p.height, p.width, p.channels, chunk);
  }
};

struct SamplePlanes final : Op {
  const char* name() const override { return "sample_planes"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t n = out.dim(0);
    const Layout p(in[0].shape());
    const Variant& v = variant_for(p);
    const Tensor owners = in.size() > 2 ? in[2] : Tensor(), any = owners_or(owners, in[1]);
    auto [range, chunk] = chunks(n, 512);
    if (v.where != "cpu") {
      launch(kernel(v), name(), range, in[0], in[1], any, out, n, owned(owners), p.rows, p.height, p.width, p.channels,
             chunk);
      return;
    }
    range.global[1] = 3;
    launch(vectors_kernel(v, "sample_planes_vectors", p.channels), name(), range, in[0], in[1], any, out, n,
           owned(owners), p.rows, p.height, p.width, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Tensors to_planes = {in[1], g}, to_points = {in[0], in[1], g};
    if (in.size() > 2) to_planes.push_back(in[2]), to_points.push_back(in[2]);
    Tensors out = {make(std::make_shared<SamplePlanesGrad>(), in[0].shape(), to_planes),
                   make(std::make_shared<SamplePlanesGradPoints>(), in[1].shape(), to_points)};
    if (in.size() > 2) out.push_back(Tensor());
    return out;
  }
};

}  // namespace

Tensor sample_planes(const Tensor& planes, const Tensor& points) {
  const Dims d = match("sample_planes", {{"planes", planes, "3 H W C"}, {"points", points, "S 3"}});
  return make(std::make_shared<SamplePlanes>(), {d["S"], 3 * d["C"]},
              {reshape(planes, {3, 1, d["H"], d["W"], d["C"]}), points});
}

Tensor sample_planes(const Tensor& planes, const Tensor& points, const Tensor& owners) {
  const Dims d =
      match("sample_planes", {{"planes", planes, "3 A H W C"}, {"points", points, "S 3"}, {"owners", owners, "S"}});
  if (owners.dtype() != DType::i32) throw Error(Fault::internal, "[sample_planes] owners must be int32");
  return make(std::make_shared<SamplePlanes>(), {d["S"], 3 * d["C"]}, {planes, points, owners});
}

}  // namespace cloam
