// Features of wide samples: Barron et al., "Zip-NeRF: Anti-Aliased Grid-Based Neural Radiance Fields", 2023, section 2.
#include <cmath>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kDownweightKernels("downweighted_mean");

/// in: features, widths, cells.
Tensor composed_mean(const Tensors& in) {
  const Tensor &widths = in[1], &cells = in[2];
  const int64_t count = widths.dim(0), places = widths.dim(1), levels = cells.dim(0);
  const Tensor across = maximum(unsqueeze(widths, 2) * cells, 1e-9f);
  const Tensor weights = unsqueeze(stop_gradient(erf(std::sqrt(0.125f) / across)), 3);
  const int64_t features = in[0].dim(1) / levels;
  return reshape(mean(reshape(in[0], {count, places, levels, features}) * weights, {{1}}), {count, levels * features});
}

struct DownweightShape {
  DownweightShape(const Shape& of_samples, const Tensor& widths, const Tensor& cells)
      : samples(widths.dim(0)),
        places(widths.dim(1)),
        levels(cells.dim(0)),
        features(static_cast<int>(of_samples[1] / levels)) {}
  int64_t samples, places, levels;
  int features;
  cl::Kernel& part(const Variant& v, const char* name) const { return kernel(v, name, {{"FEATURES", features}}); }
};

/// in: widths, cells, g -> as the features.
struct DownweightedMeanGrad final : Op {
  const char* name() const override { return "downweighted_mean_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("downweight");
    const DownweightShape of(in[2].shape(), in[0], in[1]);
    if (v.where != "cpu")
      return launch(of.part(v, name()), name(), elements(of.samples * of.places * of.levels), in[0], in[1], in[2], out,
                    of.samples, of.places, of.levels);
    const WorkShare work = share(of.samples, 256);
    launch(of.part(v, "downweighted_blocks_grad"), name(), work.range, in[0], in[1], in[2], out, of.samples, of.places,
           of.levels, work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {{}, {}, downweighted_mean(g, in[0], in[1])};  // it is linear in its third input
  }
};

/// in: features, widths, cells.
struct DownweightedMean final : Op {
  const char* name() const override { return "downweighted_mean"; }
  void run(const Tensors& in, Tensor& out) const override {
    const Variant& v = choose("downweight");
    const DownweightShape of(out.shape(), in[1], in[2]);
    if (v.where != "cpu")
      return launch(of.part(v, name()), name(), elements(of.samples * of.levels), in[0], in[1], in[2], out, of.samples,
                    of.places, of.levels);
    const WorkShare work = share(of.samples, 256);
    launch(of.part(v, "downweighted_blocks"), name(), work.range, in[0], in[1], in[2], out, of.samples, of.places,
           of.levels, work.chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {make(std::make_shared<DownweightedMeanGrad>(), in[0].shape(), {in[1], in[2], g}), {}, {}};
  }
};

void check_downweight(const char* op, const Tensor& features, const Tensor& widths, const Tensor& cells) {
  const Dims d = match(op, {{"features", features, "R N"}, {"widths", widths, "S P"}, {"cells", cells, "L"}});
  const int64_t each = d["L"] > 0 ? d["N"] / d["L"] : 0;
  if (d["R"] != d["S"] * d["P"] || d["P"] < 1 || each * d["L"] != d["N"] || (each != 1 && each != 2 && each != 4))
    throw Error(Fault::internal, text("[", op, "] features ", to_string(features.shape()), ", widths ",
                                      to_string(widths.shape()), ", cells ", to_string(cells.shape()),
                                      ": want a row for each width, with 1, 2 or 4 features of each level"));
}

}  // namespace

Tensor downweighted_mean(const Tensor& features, const Tensor& widths, const Tensor& cells) {
  check_downweight("downweighted_mean", features, widths, cells);
  return make(std::make_shared<DownweightedMean>(), {widths.dim(0), features.dim(1)}, {features, widths, cells});
}

Tensor downweighted_mean_composed(const Tensor& features, const Tensor& widths, const Tensor& cells) {
  check_downweight("downweighted_mean_composed", features, widths, cells);
  return composed_mean({features, widths, cells});
}

}  // namespace cloam
