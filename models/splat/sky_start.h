// What a cube map of the sky begins with: what photos show in its directions.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/ops.h"

namespace cloam {

/// Means of photos' colours by the texel that their pixels fall on.
class SkyStart {
 public:
  explicit SkyStart(int64_t side);
  /// rgba [P,4]; weights [P]: what each pixel counts, 0: nothing; taps [3,P]: nearest_taps (sky_map.h) of faces as wide
  /// as these.
  void add(std::span<const uint8_t> rgba, std::span<const float> weights, const Tensor& taps);
  /// [6,S,S,3]. Texels that no pixel counts for take on what lies around them on their face, the nearest most; faces of
  /// such texels alone are as dark or light as `otherwise`.
  Tensor faces(float otherwise) const;

 private:
  int64_t side_;
  std::vector<float> sums_;  // [6,S,S,4]: weighted colours, weight
};

}  // namespace cloam
