// Parameters are one map from name to tensor, read by saving, loading, optimising and data-parallel reduction alike.
// Declaring is naming: a layer asks its Scope for its tensors.
#pragma once
#include <cstdint>
#include <map>
#include <string>

#include "runtime/tensor.h"

namespace cloam {

using Params = std::map<std::string, Tensor>;

/// A place in the parameter tree. Initial values depend on the seed and the name alone, so adding a parameter shifts no
/// other.
struct Scope {
  Params& all;
  std::string path;
  uint64_t seed = 0;
  Scope operator/(const std::string& name) const { return {all, path.empty() ? name : path + "." + name, seed}; }
  /// Values uniform in [-scale, scale] (scale 0: zeros). Throws when the name is taken; Fault::memory over
  /// the budget.
  Tensor uniform(const std::string& name, const Shape& shape, float scale) const;
  Tensor constant(const std::string& name, const Shape& shape, float value) const;
};

}  // namespace cloam
