// A radiance field: what a method renders. Components behind one interface: hash grid, frequency encoding, tri-plane.
#pragma once
#include <memory>
#include <string>

#include "models/nn/params.h"

namespace cloam {

struct FieldOutput {
  Tensor sigma;  // [S] density >= 0, per unit of normalised scene length
  Tensor rgb;    // [S,3] in [0,1]
};

class Field {
 public:
  virtual ~Field() = default;
  /// points [S,3] in [0,1]^3; directions [R,3] of length 1; ray [S] int32, the direction of each point.
  virtual FieldOutput operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const = 0;
  /// [S], for the occupancy grid.
  virtual Tensor density(const Tensor& points) const = 0;
  /// Bytes of activations a sample costs in training, for the memory plan.
  virtual int64_t bytes_per_sample() const = 0;
};

struct FieldOptions {
  std::string kind = "hash";                                                   // hash | frequency | triplane
  int levels = 8, features = 4, log2_rows = 16, coarsest = 16, finest = 1024;  // hash
  int width = 64;                                                              // of the small networks
  int depth = 8, point_frequencies = 10, direction_frequencies = 4;            // frequency: paper's 8 x 256
  int plane_channels = 16, plane_side = 256;                                   // triplane
};

/// Fault::usage for an unknown kind.
std::unique_ptr<Field> make_field(const Scope& scope, const FieldOptions& options);

}  // namespace cloam
