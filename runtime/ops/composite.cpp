// Compositing of samples along rays: by densities (NeRF, Mildenhall et al. 2020) or by opacities.
#include "runtime/ops/composite.h"

#include <algorithm>
#include <bit>

#include "runtime/cl.h"
#include "runtime/ops/composed.h"

namespace cloam {
namespace {

const Registered kCompositeKernels[] = {Registered("composite"), Registered("composite_weights")};

/// The inputs of an op: matter, offsets, dt and rows where there are; of composite also features, t, ranges where there
/// are.
Tensors inputs(const Medium& m) {
  Tensors in = {m.matter, m.offsets};
  if (m.dt) in.push_back(m.dt);
  if (m.rows) in.push_back(m.rows);
  return in;
}

Tensors inputs(const Medium& m, const Contents& s) {
  Tensors in = inputs(m);
  in.insert(in.end(), {s.features, s.t});
  if (s.ranges) in.push_back(s.ranges);
  return in;
}

/// Registers for the sums of so many channels (WIDTH of composite.cl); 0: too many.
int registers_for(int64_t channels) {
  return channels <= 64 ? static_cast<int>(std::bit_ceil(static_cast<uint64_t>(std::max<int64_t>(4, channels)))) : 0;
}

/// Which inputs there are, and the scalars.
struct Form {
  bool dt, rows, sky, ranges = false;
  float near = 0;
  int64_t split = 0;

  size_t features() const { return 2 + size_t{dt} + size_t{rows}; }  // its place among the inputs
  uint64_t key() const { return uint64_t{dt} + 2 * uint64_t{rows} + 4 * uint64_t{ranges}; }
  int64_t width(int64_t channels) const { return channels + 3 + (ranges ? 2 : 0) + (dt ? 1 : 0); }
  Constants constants(int64_t channels) const {
    const int width = registers_for(channels);
    return {{"DENSITY", dt},
            {"ROWS", rows},
            {"SIGHT", ranges},
            {"WIDTH", width},
            {"WHOLE", width == 0 || width == channels}};
  }
  Medium medium(const Tensors& in) const {
    return {in[0], in[1], dt ? in[2] : Tensor(), rows ? in[2 + size_t{dt}] : Tensor(), sky};
  }
  Contents seen(const Tensors& in) const {
    const size_t k = features();
    return {in[k], in[k + 1], ranges ? in[k + 2] : Tensor(), near, split};
  }
};

/// A buffer for an argument that is not read.
const Tensor& or_any(const Tensor& tensor, const Tensor& any) { return tensor ? tensor : any; }

Tensors only(size_t count, size_t place, const Tensor& gradient) {
  Tensors out(count);
  out[place] = gradient;
  return out;
}

// ---- Weights.

Tensor weights_of(const Tensors& in, const Form& form) { return composite_weights_composed(form.medium(in)); }

/// in: those of the weights, and g -> [S] by row.
struct CompositeWeightsGrad final : Op {
  explicit CompositeWeightsGrad(const Form& f) : form(f) {}
  const char* name() const override { return "composite_weights_grad"; }
  uint64_t key() const override { return form.key(); }
  void run(const Tensors& in, Tensor& out) const override {
    const Medium m = form.medium(in);
    const int64_t rays = m.offsets.dim(0) - 1;
    const auto [range, chunk] = chunks(rays, 64);
    launch(kernel("composite", name(), form.constants(0)), name(), range, m.matter, or_any(m.dt, m.matter),
           or_any(m.rows, m.offsets), m.offsets, in.back(), out, rays, m.sky ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return vjp_of_gradient([form = form](const Tensors& x) { return weights_of(x, form); }, 0, in, g);
  }
  Form form;
};

struct CompositeWeights final : Op {
  explicit CompositeWeights(const Form& f) : form(f) {}
  const char* name() const override { return "composite_weights"; }
  uint64_t key() const override { return form.key(); }
  void run(const Tensors& in, Tensor& out) const override {
    const Medium m = form.medium(in);
    const int64_t rays = m.offsets.dim(0) - 1;
    const auto [range, chunk] = chunks(rays, 64);
    const Variant& v = choose("composite", form.dt && !form.rows && !form.sky ? "samples" : "any");
    if (v.where == "cpu")
      launch(kernel(v, "composite_samples_weights"), name(), range, m.matter, m.dt, m.offsets, out, rays, chunk);
    else
      launch(kernel("composite", name(), form.constants(0)), name(), range, m.matter, or_any(m.dt, m.matter),
             or_any(m.rows, m.offsets), m.offsets, out, rays, m.sky ? 1 : 0, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Tensors all = in;
    all.push_back(g);
    return only(in.size(), 0, make(std::make_shared<CompositeWeightsGrad>(form), in[0].shape(), all));
  }
  Form form;
};

// ---- Sums.

const Variant& sums_variant(const Form& form, int64_t channels) {
  const bool plain = form.dt && !form.rows && !form.sky && !form.ranges && channels == 3;
  return choose("composite", plain ? "samples" : "any");
}

/// As the kernels store them: with dt one more column.
Tensor sums_of(const Tensors& in, const Form& form) {
  const Tensor sums = composite_composed(form.medium(in), form.seen(in));
  return form.dt ? pad(sums, 1, 0, 1) : sums;
}

/// in: those of composite, its result and g -> [S (1 + C)]: by matter, then by features.
struct CompositeGrad final : Op {
  explicit CompositeGrad(const Form& f) : form(f) {}
  const char* name() const override { return "composite_grad"; }
  uint64_t key() const override { return form.key(); }
  void run(const Tensors& in, Tensor& out) const override {
    const Medium m = form.medium(in);
    const Contents s = form.seen(in);
    const Tensor &sums = in[in.size() - 2], &g = in.back();
    const int64_t rays = m.offsets.dim(0) - 1, channels = s.features.dim(1), samples = m.matter.dim(0);
    const auto [range, chunk] = chunks(rays, 64);
    const Variant& v = sums_variant(form, channels);
    if (v.where == "cpu")
      launch(kernel(v, "composite_samples_grad"), name(), range, m.matter, s.features, s.t, m.dt, m.offsets, sums, g,
             out, rays, samples, chunk);
    else
      launch(kernel("composite", name(), form.constants(channels)), name(), range, m.matter, or_any(m.dt, m.matter),
             or_any(m.rows, m.offsets), s.features, s.t, m.offsets, or_any(s.ranges, m.matter), sums, g, out, rays,
             samples, channels, m.sky ? 1 : 0, form.split, form.near, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto composed = [form = form](const Tensors& of) {
      const Tensors own(of.begin(), of.end() - 2);
      const Tensors each = vjp_of([&](const Tensors& x) { return sums_of(x, form); }, own, of.back());
      return packed({each[0], each[form.features()]});
    };
    return vjp_of(composed, in, g);
  }
  Form form;
};

struct Composite final : Op {
  explicit Composite(const Form& f) : form(f) {}
  const char* name() const override { return "composite"; }
  uint64_t key() const override { return form.key(); }
  void run(const Tensors& in, Tensor& out) const override {
    const Medium m = form.medium(in);
    const Contents s = form.seen(in);
    const int64_t rays = m.offsets.dim(0) - 1, channels = s.features.dim(1);
    const auto [range, chunk] = chunks(rays, 64);
    const Variant& v = sums_variant(form, channels);
    if (v.where == "cpu")
      launch(kernel(v), name(), range, m.matter, s.features, s.t, m.dt, m.offsets, out, rays, chunk);
    else
      launch(kernel("composite", name(), form.constants(channels)), name(), range, m.matter, or_any(m.dt, m.matter),
             or_any(m.rows, m.offsets), s.features, s.t, m.offsets, or_any(s.ranges, m.matter), out, rays, channels,
             m.sky ? 1 : 0, form.split, form.near, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const override {
    const Shape matter = in[0].shape(), features = in[form.features()].shape();
    Tensors all = in;
    all.insert(all.end(), {out, g});
    const Tensors each = unpacked(make(std::make_shared<CompositeGrad>(form), {numel(matter) + numel(features)}, all),
                                  {matter, features});
    Tensors gradients = only(in.size(), 0, each[0]);
    gradients[form.features()] = each[1];
    return gradients;
  }
  Form form;
};

void check_medium(const char* op, const Medium& m) {
  match(op, {{"matter", m.matter, "S"}, {"dt", or_any(m.dt, m.matter), "S"}, {"rows", or_any(m.rows, m.matter), "S"}});
  const bool offsets = m.offsets.rank() == 1 && m.offsets.dtype() == DType::i32 && m.offsets.dim(0) >= 1;
  if (!offsets || (m.rows && m.rows.dtype() != DType::i32))
    throw Error(Fault::internal,
                text("[", op, "] offsets ", to_string(m.offsets.shape()), " ", name_of(m.offsets.dtype()), ", rows ",
                     m.rows ? name_of(m.rows.dtype()) : "none", ": want int32 [R+1] and int32 [S]"));
}

// ---- Compositions.

/// What lies in front of each place, of its ray's places alone.
Tensor in_front(const Tensor& x, const Tensor& offsets) {
  const int64_t n = x.dim(0);
  const Tensor before = cumsum(pad(x, 0, 0, 1), 0, {.exclusive = true});
  const Tensor first = gather_rows(before, slice(offsets, 0, 0, offsets.dim(0) - 1));
  return slice(before, 0, 0, n) - segment_spread(first, offsets, n);
}

Tensor by_place(const Tensor& x, const Tensor& rows) { return rows ? gather_rows(x, rows) : x; }

/// 1 at each place that is the last of its ray.
Tensor is_last(const Tensor& offsets, int64_t n) {
  const Tensor ends = cast(slice(offsets, 0, 1, offsets.dim(0)), DType::f32);
  return equal(segment_spread(ends, offsets, n), cumsum(ones({n}), 0));
}

}  // namespace

Tensor composite_weights_composed(const Medium& m) {
  const Tensor matter = by_place(m.matter, m.rows);
  // 1e-30 stands for the light behind what is opaque.
  const Tensor thickness = m.dt ? matter * by_place(m.dt, m.rows) : -log(maximum(1.f - matter, 1e-30f));
  Tensor alpha = m.dt ? 1.f - exp(-thickness) : matter;
  if (m.sky) alpha = where(is_last(m.offsets, matter.dim(0)), 1.f, alpha);
  return exp(-in_front(thickness, m.offsets)) * alpha;
}

Tensor composite_composed(const Medium& m, const Contents& s) {
  const Tensor w = composite_weights_composed(m), distance = abs(s.t);
  const int64_t n = w.dim(0), rays = m.offsets.dim(0) - 1;
  const auto over_rays = [&](const Tensor& x) { return unsqueeze(segment_sum(x, m.offsets), 1); };
  Tensors columns = {segment_sum(unsqueeze(w, 1) * by_place(s.features, m.rows), m.offsets),
                     over_rays(m.sky ? w * cast(0.f <= s.t, DType::f32) : w), over_rays(w * distance),
                     zeros({rays, 1})};
  if (m.dt) {
    const auto squashed = [](const Tensor& t) { return t / (1.f + t); };
    const Tensor half = 0.5f * by_place(m.dt, m.rows), place = squashed(distance),
                 length = squashed(distance + half) - squashed(distance - half);
    const Tensor apart = place * in_front(w, m.offsets) - in_front(w * place, m.offsets);
    columns[3] = over_rays(2.f * w * apart + square(w) * length * (1.f / 3.f));
  }
  if (s.ranges) {
    const Tensor range = segment_spread(s.ranges, m.offsets, n);
    const Tensor strays = cast(range > 0.f, DType::f32) * cast(abs(distance - range) > s.near, DType::f32);
    const Tensor row = m.rows ? cast(m.rows, DType::f32) : cumsum(ones({n}), 0, {.exclusive = true});
    columns.push_back(over_rays(square(w) * strays));
    columns.push_back(over_rays(w * cast(static_cast<float>(s.split) <= row, DType::f32)));
  }
  return concat(columns, 1);
}

Tensor composite_weights(const Medium& m) {
  check_medium("composite_weights", m);
  return make(std::make_shared<CompositeWeights>(Form{bool{m.dt}, bool{m.rows}, m.sky}), m.matter.shape(), inputs(m));
}

Tensor composite(const Medium& m, const Contents& s) {
  check_medium("composite", m);
  const Dims d = match("composite", {{"matter", m.matter, "S"}, {"features", s.features, "S C"}, {"t", s.t, "S"}});
  const int64_t rays = m.offsets.dim(0) - 1;
  if (s.ranges && !(s.ranges.shape() == Shape{rays}))
    throw Error(Fault::internal,
                text("[composite] ranges is ", to_string(s.ranges.shape()), ", want one a ray: ", rays));
  const Form form{bool{m.dt}, bool{m.rows}, m.sky, bool{s.ranges}, s.near, s.split};
  const Tensor sums = make(std::make_shared<Composite>(form), {rays, form.width(d["C"])}, inputs(m, s));
  return m.dt ? slice(sums, 1, 0, form.width(d["C"]) - 1) : sums;
}

}  // namespace cloam
