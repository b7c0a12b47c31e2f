// NeuRAD's field (Tonderski et al. 2024): hash grids for the background and for all actors, whose levels are
// downweighted by how wide a sample is, and one small network for both.
#pragma once
#include "models/fields/street_field.h"
#include "runtime/ops/fields.h"

namespace cloam {

struct NeuradFieldOptions {
  HashGrid background{8, 4, 22, 32, 8192}, actors{4, 4, 13, 64, 1024};
  StreetFieldOptions network{.width = 32, .bypass = true, .residual = true};
  bool downweight = true;  // levels finer than a sample is wide count less
};

/// Where samples lie: of the background, and of actors.
struct FieldPoints {
  Tensor points;  // [S,3] in [0,1]^3
  Tensor widths;  // [S] standard deviation of what the sample stands for, in units of that cube
  Tensor owners;  // int32 [S]; of actors
};

class NeuradField {
 public:
  NeuradField(const Scope& background, const Scope& actors, const Scope& network, const NeuradFieldOptions& options,
              int64_t actor_count);
  /// What the grids say, the background's samples first: [S, numbers]. Either part may have no sample.
  Tensor encoded(const FieldPoints& background, const FieldPoints& actors) const;
  const StreetField& network() const { return network_; }

 private:
  /// A grid's features, each level times what is left of it at the sample's width (NeuRAD, section 4.2: Zip-NeRF's
  /// weights, w = 1 / max(1, 2 width resolution), of an isotropic Gaussian).
  Tensor read(const HashGridEncoder& grid, const Tensor& table, const FieldPoints& at) const;

  bool downweight_;
  HashGridEncoder background_, actors_;
  Tensor background_table_, actors_table_;  // the latter empty without actors
  StreetField network_;
};

}  // namespace cloam
