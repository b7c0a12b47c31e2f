// Random splats over a picture, in lists by tile: what the splat_blend workloads and their peer work on.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace cloam {

struct SplatInput {
  int width = 0, height = 0;
  std::vector<float> means, conics, colours, opacities;  // as Splats of runtime/ops/splat.h
  std::vector<int32_t> ids, offsets;                     // as SplatTiles
};

/// The tiles of 16 x 16 that lie within `radius` of `middle` along one axis: [first, second).
inline std::pair<int, int> splat_tiles(float middle, float radius, int tiles) {
  const auto tile = [&](float x) { return std::clamp(static_cast<int>(std::floor(x / 16)), 0, tiles); };
  return {tile(middle - radius), tile(middle + radius + 16)};
}

/// One gaussian on 9.7 pixels, anywhere and turned anyhow; deviations 1.5 to 6.6 pixels; nearer ones first. A tile
/// lists those whose square of 3 deviations meets it: 400 thousand pairs of tile and gaussian at 800 x 608.
inline SplatInput splat_input(int width, int height) {
  SplatInput in;
  in.width = width, in.height = height;
  uint64_t state = 1;
  const auto uniform = [&state] {  // Knuth's MMIX generator, upper bits
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<float>(state >> 40) * 0x1p-24f;
  };
  const int across = (width + 15) / 16, down = (height + 15) / 16;
  const auto count = static_cast<int>(int64_t{50000} * width * height / (800 * 608));
  std::vector<std::vector<int32_t>> lists(static_cast<size_t>(across * down));
  for (int i = 0; i < count; i++) {
    const float x = uniform() * static_cast<float>(width), y = uniform() * static_cast<float>(height);
    const float s = 1.5f + 5.1f * uniform(), t = 1.5f + 5.1f * uniform(), turn = 3.14159265f * uniform();
    const float cosine = std::cos(turn), sine = std::sin(turn), p = 1 / (s * s), q = 1 / (t * t);
    in.means.insert(in.means.end(), {x, y});
    in.conics.insert(in.conics.end(), {p * cosine * cosine + q * sine * sine, (p - q) * cosine * sine,
                                       p * sine * sine + q * cosine * cosine});
    for (int channel = 0; channel < 3; channel++) in.colours.push_back(uniform());
    in.opacities.push_back(0.05f + 0.9f * uniform());
    const auto [left, right] = splat_tiles(x, 3 * std::max(s, t), across);
    const auto [top, bottom] = splat_tiles(y, 3 * std::max(s, t), down);
    for (int row = top; row < bottom; row++)
      for (int column = left; column < right; column++) lists[static_cast<size_t>(row * across + column)].push_back(i);
  }
  in.offsets.push_back(0);
  for (const std::vector<int32_t>& list : lists) {
    in.ids.insert(in.ids.end(), list.begin(), list.end());
    in.offsets.push_back(static_cast<int32_t>(in.ids.size()));
  }
  return in;
}

}  // namespace cloam
