// See placing.h.
#include "runtime/ops/placing.h"

#include "runtime/cl.h"
#include "runtime/ops/composed.h"

namespace cloam {
namespace {

const Registered kPlacingKernels[] = {Registered("place_things"), Registered("add_waves")};

constexpr int64_t kPlaced = 15, kLearned = 4;  // numbers of a thing; a shift and a turn

enum Input : size_t { kPoses, kShifts, kTurns, kRows, kShares, kSides, kView };

/// [N,4], the mixed shift and turn of each thing, `of` being the inputs of place_things.
Tensor learned_of(const Tensors& of) {
  return sum(gather_rows(concat({of[kShifts], of[kTurns]}, 1), of[kRows]) * unsqueeze(of[kShares], 2), {{1}});
}

/// a [.., I,J] and b [.., J,K] of few numbers, broadcast: sums in the order of J, as the kernel's.
Tensor product(const Tensor& a, const Tensor& b) { return sum(unsqueeze(a, -1) * unsqueeze(b, -3), {{-2}}); }

Tensor placed(const Tensors& of, const Tensor& learned) {
  const int64_t count = learned.dim(0);
  const Tensor axes = slice(of[kPoses], 2, 0, 3), at = slice(of[kPoses], 2, 3, 4);
  const Tensor turn = reshape(slice(learned, 1, 3, 4), {count, 1, 1}), x = slice(axes, 2, 0, 1),
               y = slice(axes, 2, 1, 2);
  const Tensor side = reshape(of[kSides], {count, 1, 1});
  const Tensor turned =
      concat({side * (cos(turn) * x + sin(turn) * y), cos(turn) * y - sin(turn) * x, slice(axes, 2, 2, 3)}, 2);
  const Tensor there = at + product(axes, reshape(slice(learned, 1, 0, 3), {count, 3, 1}));
  const Tensor of_view = unsqueeze(slice(of[kView], 1, 0, 3), 0), shift = unsqueeze(slice(of[kView], 1, 3, 4), 0);
  const Tensor views = concat({product(of_view, turned), shift + product(of_view, there)}, 2);
  const Tensor eyes = product(transpose(turned), -product(transpose(of_view), shift) - there);
  return concat({reshape(views, {count, 12}), reshape(eyes, {count, 3})}, 1);
}

/// in: as place_things, g -> [N,2,4].
struct PlaceThingsGrad final : Op {
  const char* name() const override { return "place_things_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 64);
    launch(kernel("placing", name()), name(), range, in[kPoses], in[kShifts], in[kTurns], in[kRows], in[kShares],
           in[kSides], in[kView], in.back(), out, out.dim(0), in[kShifts].dim(0), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    const auto gradient = [](const Tensors& of) {
      const Tensor by = vjp_of([&](const Tensors& x) { return placed(of, x[0]); }, {learned_of(of)}, of.back())[0];
      return unsqueeze(by, 1) * unsqueeze(of[kShares], 2);
    };
    return vjp_of(gradient, in, g);
  }
};

struct PlaceThings final : Op {
  const char* name() const override { return "place_things"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 64);
    launch(kernel("placing", name()), name(), range, in[kPoses], in[kShifts], in[kTurns], in[kRows], in[kShares],
           in[kSides], in[kView], out, out.dim(0), in[kShifts].dim(0), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    Tensors all = in, gradients(in.size());
    all.push_back(g);
    const int64_t count = in[kPoses].dim(0);
    const Tensor by_rows = make(std::make_shared<PlaceThingsGrad>(), {count, 2, kLearned}, all);
    const Tensor learned =
        scatter_add_rows(reshape(by_rows, {2 * count, kLearned}), reshape(in[kRows], {2 * count}), in[kShifts].dim(0));
    gradients[kShifts] = slice(learned, 1, 0, 3);
    gradients[kTurns] = slice(learned, 1, 3, 4);
    return gradients;
  }
};

Tensors inputs_of(const Standings& things, const Tensor& view) {
  match("place_things", {{"poses", things.poses, "N 3 4"},
                         {"shifts", things.shifts, "B 3"},
                         {"turns", things.turns, "B 1"},
                         {"rows", things.rows, "N 2"},
                         {"shares", things.shares, "N 2"},
                         {"sides", things.sides, "N"},
                         {"view", view, "3 4"}});
  if (things.rows.dtype() != DType::i32 || things.shifts.dim(0) == 0)
    throw Error(Fault::internal, text("[place_things] rows is ", name_of(things.rows.dtype()), " into a table of ",
                                      things.shifts.dim(0), ", want int32 and one row at least"));
  return {things.poses, things.shifts, things.turns, things.rows, things.shares, things.sides, view};
}

/// in: heights, owners, g -> [G,W,3].
struct AddWavesGrad final : Op {
  const char* name() const override { return "add_waves_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 512);
    launch(kernel("placing", name()), name(), range, in[0], in[1], in[2], out, out.dim(0), out.dim(1), in[0].dim(0),
           chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {Tensor(), Tensor(), add_waves(zeros(in[2].shape()), {g, in[0], in[1]})};
  }
};

/// in: first, amplitudes, heights, owners.
struct AddWaves final : Op {
  const char* name() const override { return "add_waves"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(0), 512);
    launch(kernel("placing", name()), name(), range, in[0], in[1], in[2], in[3], out, out.dim(0), in[1].dim(1),
           in[2].dim(0), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {g, make(std::make_shared<AddWavesGrad>(), in[1].shape(), {in[2], in[3], g}), Tensor(), Tensor()};
  }
};

void check_waves(const Tensor& first, const Waves& waves) {
  match("add_waves", {{"first", first, "G 3"},
                      {"amplitudes", waves.amplitudes, "G W 3"},
                      {"heights", waves.heights, "N W"},
                      {"owners", waves.owners, "G"}});
  if (waves.owners.dtype() != DType::i32 || waves.heights.dim(0) == 0)
    throw Error(Fault::internal, text("[add_waves] owners is ", name_of(waves.owners.dtype()), " of ",
                                      waves.heights.dim(0), " things, want int32 and one thing at least"));
}

}  // namespace

Tensor place_things(const Standings& things, const Tensor& view) {
  const Tensors in = inputs_of(things, view);
  return make(std::make_shared<PlaceThings>(), {things.poses.dim(0), kPlaced}, in);
}

Tensor place_things_composed(const Standings& things, const Tensor& view) {
  const Tensors in = inputs_of(things, view);
  return placed(in, learned_of(in));
}

Tensor add_waves(const Tensor& first, const Waves& waves) {
  check_waves(first, waves);
  return make(std::make_shared<AddWaves>(), first.shape(), {first, waves.amplitudes, waves.heights, waves.owners});
}

Tensor add_waves_composed(const Tensor& first, const Waves& waves) {
  check_waves(first, waves);
  return first + sum(waves.amplitudes * unsqueeze(gather_rows(waves.heights, waves.owners), 2), {{1}});
}

}  // namespace cloam
