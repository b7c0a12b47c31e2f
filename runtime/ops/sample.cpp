// Bilinear sampling of images, of which tri-planes (EG3D, Chan et al. 2022, section 4.1; yz as the third plane) are
// three.
#include "runtime/ops/sample.h"

#include <algorithm>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/places.h"
#include "runtime/ops/scan.h"

namespace cloam {
namespace {

const Registered kSampleKernels("sample_images");

/// Images [P,A,H,W,C] as the kernels see them.
struct ImageStack {
  explicit ImageStack(const Shape& images)
      : count(images[0]), rows(images[1] * images[2]), height(images[2]), width(images[3]), channels(images[4]) {}
  int64_t count, rows, height, width, channels;
};

/// Vectors: whole rows of them, and coordinates of 15 bits.
const Variant& variant_for(const ImageStack& p) {
  const bool vectors = p.channels % 4 == 0 && p.channels <= 256 && std::max(p.rows, p.width) < 32768;
  return choose("sample", vectors ? "vectors" : "any");
}

cl::Kernel& vectors_kernel(const Variant& v, const char* name, int64_t channels) {
  const int lanes = channels % 16 == 0 ? 16 : 4;
  return kernel(v, name, {{"LANES", lanes}, {"VECTORS", static_cast<int>(channels / lanes)}});
}

Tensor composed_samples(const Tensors& in);

/// in: points, perhaps owners, g -> [P,A,H,W,C].
struct SampleGradImages final : Op {
  const char* name() const override { return "sample_dimages"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = variant_for(ImageStack(out.shape()));
    v.where == "cpu" ? by_bands(v, in, out) : by_pairs(in, out);
  }
  static void by_pairs(const Tensors& in, Tensor& out);
  static void by_bands(const Variant& v, const Tensors& in, const Tensor& out);
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const auto gradient = [shape = out.shape()](const Tensors& of) {
      Tensors own = {zeros(shape)};  // whatever they are: samples are linear in them
      own.insert(own.end(), of.begin(), of.end() - 1);
      return vjp_of(composed_samples, own, of.back())[0];
    };
    return vjp_of(gradient, in, g);
  }
};

void SampleGradImages::by_pairs(const Tensors& in, Tensor& out) {
  const Places of(in, 0, in.size() - 1);
  const ImageStack p(out.shape());
  const int64_t n = of.points.dim(0), items = n * p.count;
  const Tensor rows = empty({items * 4}, DType::i32), values = empty({items * 4, p.channels});
  launch(kernel("sample", "sample_pairs"), "sample_pairs", elements(items), of.points, of.owners, in.back(), rows,
         values, n, of.points.dim(1), of.owned ? 1 : 0, p.rows, p.height, p.width, p.channels);
  const Tensor sums = reshape(scatter_add_rows(values, rows, p.count * p.rows * p.width), out.shape());
  adopt(out, sums);
}

void SampleGradImages::by_bands(const Variant& v, const Tensors& in, const Tensor& out) {
  const Places of(in, 0, in.size() - 1);
  const ImageStack p(out.shape());
  const int64_t n = of.points.dim(0), axes = of.points.dim(1), bands = (p.rows + v["BAND"] - 1) / v["BAND"];
  const int64_t chunk = std::max<int64_t>(1024, (n + 31) / 32), chunks = std::max<int64_t>(1, (n + chunk - 1) / chunk);
  const Tensor counts = empty({p.count * bands * chunks}, DType::i32), starts = empty(counts.shape(), DType::i32);
  const Tensor list = empty({std::max<int64_t>(1, 2 * p.count * n), 4}, DType::i32);
  launch(vectors_kernel(v, "sample_count", p.channels), "sample_count", range2(chunks, p.count), of.points, of.owners,
         counts, n, axes, of.owned ? 1 : 0, p.rows, p.height, chunks, chunk);
  scan_rows(counts, starts, 1, {.exclusive = true});
  launch(vectors_kernel(v, "sample_list", p.channels), "sample_list", range2(chunks, p.count), of.points, of.owners,
         starts, list, n, axes, of.owned ? 1 : 0, p.rows, p.height, p.width, chunks, chunk);
  launch(vectors_kernel(v, "sample_add", p.channels), "sample_add", range2(bands, p.count), in.back(), list, starts,
         out, p.rows, p.height, p.width, chunks);
}

/// in: images, points, perhaps owners, g -> [S,axes].
struct SampleGradPoints final : Op {
  const char* name() const override { return "sample_dpoints"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Places of(in, 1, in.size() - 1);
    const auto [range, chunk] = chunks(out.dim(0), 512);
    const ImageStack p(in[0].shape());
    launch(kernel("sample", name()), name(), range, in[0], of.points, of.owners, in.back(), out, out.dim(0), out.dim(1),
           of.owned ? 1 : 0, p.rows, p.height, p.width, p.channels, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return vjp_of_gradient(composed_samples, 1, in, g);
  }
};

struct Sample final : Op {
  const char* name() const override { return "sample_images"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Places of(in, 1, in.size());
    const int64_t n = out.dim(0), axes = of.points.dim(1);
    const ImageStack p(in[0].shape());
    const Variant& v = variant_for(p);
    auto [range, chunk] = chunks(n, 512);
    if (v.where != "cpu") {
      launch(kernel(v), name(), range, in[0], of.points, of.owners, out, n, axes, of.owned ? 1 : 0, p.rows, p.height,
             p.width, p.channels, chunk);
      return;
    }
    range.global[1] = static_cast<size_t>(p.count);
    launch(vectors_kernel(v, "sample_vectors", p.channels), name(), range, in[0], of.points, of.owners, out, n, axes,
           of.owned ? 1 : 0, p.rows, p.height, p.width, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Tensors all = in, gradients(in.size());
    all.push_back(g);
    gradients[0] = make(std::make_shared<SampleGradImages>(), in[0].shape(), {all.begin() + 1, all.end()});
    gradients[1] = make(std::make_shared<SampleGradPoints>(), in[1].shape(), all);
    return gradients;
  }
};

/// The texels around places along one axis, and how far places are from the lower to the upper.
struct Taps {
  Taps(const Tensor& places, int64_t size) {
    const auto last = static_cast<int>(size - 1);
    const Tensor at = clamp(places * static_cast<float>(size) - 0.5f, 0.f, static_cast<float>(last));
    low = cast(at, DType::i32);
    high = minimum(low + 1, last);
    part = unsqueeze(at - floor(at), 2);
  }
  Tensor low, high, part;
};

Tensor mixed(const Tensor& a, const Tensor& b, const Tensor& part) { return a * (1.f - part) + b * part; }

/// Of [P,A,H,W,C]: sums of four rows of texels.
Tensor composed_samples(const Tensors& in) {
  const Places of(in, 1, in.size());
  const ImageStack p(in[0].shape());
  const auto axis = [&](int i) { return slice(of.points, 1, i, i + 1); };
  const bool planes = p.count == 3;
  const Taps x(planes ? concat({axis(0), axis(0), axis(1)}, 1) : axis(0), p.width);
  const Taps y(planes ? concat({axis(1), axis(2), axis(2)}, 1) : axis(1), p.height);
  std::vector<int32_t> firsts;
  for (int64_t image = 0; image < p.count; image++) firsts.push_back(static_cast<int32_t>(image * p.rows));
  Tensor first = from_host(firsts, {1, p.count});
  if (of.owned) first = first + unsqueeze(of.owners, 1) * static_cast<int>(p.height);
  const Tensor texels = reshape(in[0], {p.count * p.rows * p.width, p.channels});
  const auto row = [&](const Tensor& line) {
    const Tensor begin = (first + line) * static_cast<int>(p.width);
    return mixed(gather_rows(texels, begin + x.low), gather_rows(texels, begin + x.high), x.part);
  };
  return reshape(mixed(row(y.low), row(y.high), y.part), {of.points.dim(0), p.count * p.channels});
}

/// The inputs of the op; `count` images a point.
Tensors inputs(const char* op, int64_t count, const Tensor& images, const Tensor& points, const Tensor& owners) {
  const bool planes = count == 3;
  const char* const wanted = owners ? (planes ? "3 A H W C" : "A H W C") : (planes ? "3 H W C" : "H W C");
  const Dims d =
      match(op, {{planes ? "planes" : "images", images, wanted}, {"points", points, planes ? "S 3" : "S 2"}});
  const Tensor stack = reshape(images, {count, owners ? d["A"] : 1, d["H"], d["W"], d["C"]});
  check_owners(op, owners, points);
  return owners ? Tensors{stack, points, owners} : Tensors{stack, points};
}

Tensor sampled(const Tensors& in) {
  const ImageStack p(in[0].shape());
  return make(std::make_shared<Sample>(), {in[1].dim(0), p.count * p.channels}, in);
}

}  // namespace

void check_owners(const char* op, const Tensor& owners, const Tensor& points) {
  if (owners && (owners.dtype() != DType::i32 || !(owners.shape() == Shape{points.dim(0)})))
    throw Error(Fault::internal, text("[", op, "] owners is ", to_string(owners.shape()), " ", name_of(owners.dtype()),
                                      ", want int32, one a point: ", points.dim(0)));
}

Tensor sample_images(const Tensor& images, const Tensor& places, const Tensor& owners) {
  return sampled(inputs("sample_images", 1, images, places, owners));
}

Tensor sample_images_composed(const Tensor& images, const Tensor& places, const Tensor& owners) {
  return composed_samples(inputs("sample_images", 1, images, places, owners));
}

Tensor sample_planes(const Tensor& planes, const Tensor& points, const Tensor& owners) {
  return sampled(inputs("sample_planes", 3, planes, points, owners));
}

Tensor sample_planes_composed(const Tensor& planes, const Tensor& points, const Tensor& owners) {
  return composed_samples(inputs("sample_planes", 3, planes, points, owners));
}

}  // namespace cloam
