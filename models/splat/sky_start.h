// What a cube map of the sky begins with: what photos show in its directions.
#pragma once
#include <array>
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
  /// [6,S,S,3]. Texels that no pixel counts for take on what lies around them on their face, the nearest most; on a
  /// face of such texels alone, what the other sides show as high above the horizon (z is up). Grey where no side shows
  /// anything: `otherwise`.
  Tensor faces(float otherwise) const;

  using Colour = std::array<float, 3>;
  /// A square image of which parts are not known.
  struct Face {
    int64_t side = 0;
    std::vector<Colour> colours;
    std::vector<bool> known;
  };

 private:
  Face face(int64_t number) const;

  int64_t side_;
  std::vector<float> sums_;  // [6,S,S,4]: weighted colours, weight
};

}  // namespace cloam
