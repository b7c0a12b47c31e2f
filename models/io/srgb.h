// The transfer function of sRGB (IEC 61966-2-1): what images store of light.
#pragma once
#include <algorithm>
#include <cmath>

namespace cloam {

/// From sRGB to light; clamped to 0 and 1.
inline float linear_colour(float srgb) {
  const float value = std::clamp(srgb, 0.f, 1.f);
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

/// Back; clamped to 0 and 1.
inline float srgb_colour(float linear) {
  const float light = std::clamp(linear, 0.f, 1.f);
  return light <= 0.0031308f ? 12.92f * light : 1.055f * std::pow(light, 1 / 2.4f) - 0.055f;
}

}  // namespace cloam
