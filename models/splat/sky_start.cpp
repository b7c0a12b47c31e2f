// See sky_start.h.
#include "models/splat/sky_start.h"

#include <algorithm>
#include <cmath>

#include "runtime/ops/cube_map.h"

namespace cloam {
namespace {

using Colour = SkyStart::Colour;
using Face = SkyStart::Face;

constexpr size_t kSides = 4, kAbove = 4;  // faces at +x, -x, +y, -y, whose rows run along z; the one at +z

bool any_known(const Face& face) { return std::find(face.known.begin(), face.known.end(), true) != face.known.end(); }

/// Half as wide: each texel is the mean of those of its four that are known.
Face halved(const Face& from) {
  Face out{(from.side + 1) / 2, {}, {}};
  for (int64_t row = 0; row < out.side; ++row)
    for (int64_t column = 0; column < out.side; ++column) {
      Colour sum{};
      float count = 0;
      for (int64_t y = 2 * row; y < std::min(from.side, 2 * row + 2); ++y)
        for (int64_t x = 2 * column; x < std::min(from.side, 2 * column + 2); ++x) {
          const auto at = static_cast<size_t>(y * from.side + x);
          if (!from.known[at]) continue;
          for (size_t c = 0; c < 3; ++c) sum[c] += from.colours[at][c];
          ++count;
        }
      for (float& value : sum) value /= std::max(1.f, count);
      out.colours.push_back(sum);
      out.known.push_back(count > 0);
    }
  return out;
}

/// Bilinear, of an image half as wide.
Colour enlarged(const Face& small, int64_t row, int64_t column) {
  const auto place = [&](int64_t at) {
    return std::clamp((static_cast<float>(at) + 0.5f) / 2 - 0.5f, 0.f, static_cast<float>(small.side - 1));
  };
  const float y = place(row), x = place(column);
  const auto top = static_cast<int64_t>(y), left = static_cast<int64_t>(x);
  Colour out{};
  for (int64_t i = top; i < std::min(small.side, top + 2); ++i)
    for (int64_t j = left; j < std::min(small.side, left + 2); ++j) {
      const float share = (1 - std::abs(y - static_cast<float>(i))) * (1 - std::abs(x - static_cast<float>(j)));
      for (size_t c = 0; c < 3; ++c) out[c] += share * small.colours[static_cast<size_t>(i * small.side + j)][c];
    }
  return out;
}

/// What is not known is read from the image half as wide, which is filled first (pull and push: Gortler et al. 1996,
/// The Lumigraph, section 3.4).
void fill(Face& face) {
  if (face.side == 1 || std::find(face.known.begin(), face.known.end(), false) == face.known.end()) return;
  Face small = halved(face);
  fill(small);
  for (int64_t row = 0; row < face.side; ++row)
    for (int64_t column = 0; column < face.side; ++column)
      if (const auto at = static_cast<size_t>(row * face.side + column); !face.known[at])
        face.colours[at] = enlarged(small, row, column);
}

/// The mean of what is known in a row of all sides; of a row in which nothing is, that of the nearest row below, or
/// above.
std::vector<Colour> colours_by_height(const std::vector<Face>& sides, float otherwise) {
  const auto side = static_cast<size_t>(sides.front().side);
  std::vector<Colour> rows(side);
  std::vector<bool> known(side);
  for (size_t row = 0; row < side; ++row) {
    float count = 0;
    for (const Face& face : sides)
      for (size_t i = row * side; i < (row + 1) * side; ++i) {
        if (!face.known[i]) continue;
        for (size_t c = 0; c < 3; ++c) rows[row][c] += face.colours[i][c];
        ++count;
      }
    for (float& value : rows[row]) value /= std::max(1.f, count);
    known[row] = count > 0;
  }
  const auto first = static_cast<size_t>(std::find(known.begin(), known.end(), true) - known.begin());
  if (first == side) return std::vector<Colour>(side, {otherwise, otherwise, otherwise});
  for (size_t row = 0; row < side; ++row)
    if (!known[row]) rows[row] = rows[row < first ? first : row - 1];
  return rows;
}

}  // namespace

SkyStart::SkyStart(int64_t side) : side_(side), sums_(static_cast<size_t>(24 * side * side)) {}

void SkyStart::add(std::span<const uint8_t> rgba, std::span<const float> weights, const Tensor& taps) {
  const std::vector<int32_t> places = taps.to_host<int32_t>();
  const size_t count = weights.size();
  for (size_t i = 0; i < count; ++i) {
    if (weights[i] <= 0) continue;
    const int64_t right = places[count + i] / kTapUnit, below = places[2 * count + i] / kTapUnit;
    float* const sum = &sums_[4 * static_cast<size_t>(places[i] + right + below * side_)];
    for (size_t c = 0; c < 3; ++c) sum[c] += weights[i] * static_cast<float>(rgba[4 * i + c]) / 255;
    sum[3] += weights[i];
  }
}

Face SkyStart::face(int64_t number) const {
  Face face{side_, {}, {}};
  const auto texels = static_cast<size_t>(side_ * side_), first = static_cast<size_t>(number) * texels;
  for (size_t i = first; i < first + texels; ++i) {
    const float* const sum = &sums_[4 * i];
    face.known.push_back(sum[3] > 0);
    Colour colour{};
    for (size_t c = 0; c < 3 && sum[3] > 0; ++c) colour[c] = sum[c] / sum[3];
    face.colours.push_back(colour);
  }
  return face;
}

Tensor SkyStart::faces(float otherwise) const {
  std::vector<Face> faces;
  for (int64_t number = 0; number < 6; ++number) faces.push_back(face(number));
  const std::vector<Colour> heights = colours_by_height({faces.begin(), faces.begin() + kSides}, otherwise);
  std::vector<float> out;
  out.reserve(static_cast<size_t>(18 * side_ * side_));
  for (size_t number = 0; number < faces.size(); ++number) {
    Face& face = faces[number];
    if (any_known(face))
      fill(face);
    else if (number < kSides)
      for (size_t i = 0; i < face.colours.size(); ++i) face.colours[i] = heights[i / heights.size()];
    else
      std::fill(face.colours.begin(), face.colours.end(), number == kAbove ? heights.back() : heights.front());
    for (const Colour& colour : face.colours) out.insert(out.end(), colour.begin(), colour.end());
  }
  return from_host(out, {6, side_, side_, 3});
}

}  // namespace cloam
