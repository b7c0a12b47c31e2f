// See cube_map.h.
#include "runtime/ops/cube_map.h"

#include <algorithm>

#include "runtime/cl.h"

namespace cloam {
namespace {

const Registered kCubeMapKernels[] = {Registered("cube_taps"), Registered("cube_colours")};

constexpr int64_t kMaxSide = 16384;  // texels are counted in 31 bits

/// Rows of texels that one work-item adds to: as many as stay in a core's cache, or a lane each.
int64_t band_rows() { return is_cpu_class() ? 8 : 1; }

cl::Kernel& cube_kernel(const char* name) {
  return kernel("cube_map", name, {{"BAND", static_cast<int>(band_rows())}});
}

/// in: directions, turn.
struct CubeTaps final : Op {
  explicit CubeTaps(int64_t size) : side(size) {}
  const char* name() const override { return "cube_taps"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(1), 512);
    launch(cube_kernel(name()), name(), range, in[0], in[1], out, out.dim(1), side, chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor&) const override { return Tensors(in.size()); }
  int64_t side;
};

/// in: taps, g [3,P] -> [6,S,S,3].
struct CubeGrad final : Op {
  const char* name() const override { return "cube_grad"; }
  void run(const Tensors& in, Tensor& out) const override {
    const int64_t count = in[0].dim(1), side = out.dim(1), band = band_rows(), lanes = band > 1 ? 1 : 64;
    const int64_t bands = (6 * side + band - 1) / band, chunk = std::clamp<int64_t>((count + 31) / 32, 1024, 32768),
                  parts = std::max<int64_t>(1, (count + chunk - 1) / chunk);
    const Tensor starts = empty({parts, bands + 1}, DType::i32), list = empty({2 * parts * chunk}, DType::i32);
    launch(cube_kernel("cube_list"), "cube_list", range1(parts, lanes), in[0], starts, list, count, side, bands, parts,
           chunk);
    launch(cube_kernel("cube_add"), "cube_add", range1(bands, lanes), in[0], in[1], starts, list, out, count, side,
           bands, parts);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {Tensor(), cube_colours(g, in[0])};
  }
};

/// in: faces, taps.
struct CubeColours final : Op {
  const char* name() const override { return "cube_colours"; }
  void run(const Tensors& in, Tensor& out) const override {
    const auto [range, chunk] = chunks(out.dim(1), 512);
    launch(cube_kernel(name()), name(), range, in[0], in[1], out, out.dim(1), in[0].dim(1), chunk);
  }
  Tensors vjp(const Tensors& in, const Tensor&, const Tensor& g) const override {
    return {make(std::make_shared<CubeGrad>(), in[0].shape(), {in[1], g}), Tensor()};
  }
};

void check_faces(const Tensor& faces, const Tensor& taps) {
  match("cube_colours", {{"faces", faces, "6 S S 3"}, {"taps", taps, "3 P"}});
  if (taps.dtype() != DType::i32 || faces.dim(1) < 1 || faces.dim(1) > kMaxSide)
    throw Error(Fault::internal, text("[cube_colours] taps is ", name_of(taps.dtype()), " of faces ", faces.dim(1),
                                      " wide, want int32 of 1 to ", kMaxSide));
}

}  // namespace

Tensor cube_taps(const Tensor& directions, const Tensor& turn, int64_t side) {
  match("cube_taps", {{"directions", directions, "P 3"}, {"turn", turn, "3 3"}});
  return make(std::make_shared<CubeTaps>(side), {3, directions.dim(0)}, {directions, turn}, DType::i32);
}

Tensor cube_colours(const Tensor& faces, const Tensor& taps) {
  check_faces(faces, taps);
  return make(std::make_shared<CubeColours>(), {3, taps.dim(1)}, {faces, taps});
}

Tensor cube_colours_composed(const Tensor& faces, const Tensor& taps) {
  check_faces(faces, taps);
  const int64_t side = faces.dim(1), count = taps.dim(1);
  const int right = side > 1 ? 1 : 0, below = side > 1 ? static_cast<int>(side) : 0;
  const Tensor texels = reshape(faces, {6 * side * side, 3}), first = reshape(slice(taps, 0, 0, 1), {count});
  const auto part = [&](int64_t row) {
    return reshape(cast(slice(taps, 0, row, row + 1), DType::f32) / static_cast<float>(kTapUnit), {count, 1});
  };
  const auto at = [&](int shift) { return gather_rows(texels, first + shift); };
  const Tensor across = part(1), down = part(2);
  const auto mixed = [](const Tensor& a, const Tensor& b, const Tensor& share) {
    return a * (1.f - share) + b * share;
  };
  return transpose(mixed(mixed(at(0), at(right), across), mixed(at(below), at(below + right), across), down));
}

}  // namespace cloam
