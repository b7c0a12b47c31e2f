// Tri-plane field (EG3D, Chan et al. 2022; planes xy, xz, yz; features concatenated as SSDNeRF does).
#pragma once
#include "models/fields/hash_field.h"

namespace cloam {

class TriplaneField final : public Field {
 public:
  TriplaneField(const Scope& scope, const FieldOptions& options);
  FieldOutput operator()(const Tensor& points, const Tensor& directions, const Tensor& ray) const override;
  Tensor density(const Tensor& points) const override;
  int64_t bytes_per_sample() const override { return 4 * (2 * 3 * channels_ + 4 * width_ + 5 * 16); }

 private:
  int64_t channels_, width_;
  Tensor planes_;
  SplitNetwork network_;
};

}  // namespace cloam
