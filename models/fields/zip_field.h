// Zip-NeRF's field (Barron et al. 2023): a hash grid whose levels count by how wide a sample is, read at several places
// of each sample.
#pragma once
#include "models/fields/field.h"
#include "models/nn/layers.h"
#include "runtime/ops/fields.h"

namespace cloam {

/// What samples stand for: K isotropic Gaussians each. No gradient goes to their widths.
struct WideSamples {
  Tensor points;  // [S,K,3] in [0,1]^3
  Tensor widths;  // [S,K] standard deviations in units of that cube; an empty handle: points without width
};

/// A hash grid and its table.
class DownweightedGrid {
 public:
  DownweightedGrid(const Scope& scope, const HashGrid& grid);
  /// [S, levels * features]: the mean over the K, each level times erf(1 / (sqrt(8) width resolution)), the share of
  /// the Gaussian within half a cell of its middle (section 3.2).
  Tensor operator()(const WideSamples& at) const;
  /// Sum over the levels of the mean square of their rows (section 4.3).
  Tensor decay() const;
  int64_t numbers() const { return int64_t{encoder_.grid.levels} * encoder_.grid.features; }

 private:
  HashGridEncoder encoder_;
  Tensor table_;
  Tensor cells_;      // [levels] per axis
  Tensor used_rows_;  // [levels,1]: 1 / the numbers of a level that points can read
};

/// Density alone: grid, one hidden layer.
class ZipDensity {
 public:
  struct Options {
    int width = 64, outputs = 1;
    bool exponential = false;
  };
  ZipDensity(const Scope& scope, const HashGrid& grid, const Options& options);
  /// The network's outputs [S,outputs]; the first is density()'s.
  Tensor features(const WideSamples& at) const;
  /// [S]: of the first number x softplus(x - 1), as the paper has it, or exp(x - 1), which reaches the density of a
  /// surface in fewer steps (Müller et al. 2022, "Instant Neural Graphics Primitives").
  Tensor density(const Tensor& features) const;
  const DownweightedGrid& grid() const { return grid_; }

 private:
  DownweightedGrid grid_;
  Linear hidden_, out_;
  bool exponential_;
};

struct ZipFieldOptions {
  HashGrid grid{10, 4, 21, 16, 8192};
  int width = 64, bottleneck = 256, colour_width = 256;
  std::string density = "softplus";  // or "exp": of the first of the geometry's numbers
};

/// Density and colour.
class ZipField {
 public:
  ZipField(const Scope& scope, const ZipFieldOptions& options);
  /// directions [R,3] of length 1; ray [S] int32, the direction of each sample.
  FieldOutput operator()(const WideSamples& at, const Tensor& directions, const Tensor& ray) const;
  /// [S]
  Tensor density(const WideSamples& at) const { return geometry_.density(geometry_.features(at)); }
  const DownweightedGrid& grid() const { return geometry_.grid(); }
  /// Bytes of activations a sample of `places` costs in training, for the memory plan.
  int64_t bytes_per_sample(int64_t places) const;

 private:
  ZipFieldOptions options_;
  ZipDensity geometry_;
  Linear first_, second_, colour_;
};

}  // namespace cloam
