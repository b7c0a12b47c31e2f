// Gaussians of a kind that files hold, made by chance.
#pragma once
#include <random>

#include "models/gaussians/gaussians.h"

namespace cloam {

/// Values such as trained gaussians have, with harmonics up to a degree.
inline Gaussians invented(std::size_t count, int degree, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  Gaussians g;
  const auto fill = [&](std::vector<float>& values, std::size_t size, float middle, float spread) {
    for (std::size_t i = 0; i < size; ++i) values.push_back(middle + spread * normal(random));
  };
  fill(g.means, 3 * count, 0, 5);
  fill(g.scales, 3 * count, -4, 1);
  fill(g.rotations, 4 * count, 0, 1);
  fill(g.opacities, count, 0, 2);
  fill(g.sh_first, 3 * count, 0, 1);
  fill(g.sh_rest, 3 * kSphericalRest * count, 0, 0.2f);
  for (std::size_t i = 0; i < g.sh_rest.size(); ++i) {
    if (int(i / 3 % kSphericalRest) >= (degree + 1) * (degree + 1) - 1) g.sh_rest[i] = 0;
  }
  return g;
}

}  // namespace cloam
