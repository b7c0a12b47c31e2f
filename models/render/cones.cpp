// See cones.h.
#include "models/render/cones.h"

#include <cmath>
#include <numbers>

namespace cloam {
namespace {

constexpr float kTurn = 2 * std::numbers::pi_v<float>;
// Places of the samples along the ray and around it, which spread evenly about it (Zip-NeRF, figure 3).
constexpr int64_t kSix = 6;
const std::vector<float> kAngles = {0, 2, 4, 3, 5, 1};  // sixths of a turn
constexpr float kWidthShare = 0.5f;                     // of a sample's deviation in the frustum's

/// Middle and half length of the pieces, [R,N].
struct Pieces {
  Tensor middle, half, begin, end;
};
Pieces pieces_of(const Tensor& edges) {
  const int64_t n = edges.dim(1) - 1;
  const Tensor begin = slice(edges, 1, 0, n), end = slice(edges, 1, 1, n + 1);
  return {(begin + end) * 0.5f, (end - begin) * 0.5f, begin, end};
}

Tensor part(const Tensor& vectors, int64_t i) { return slice(vectors, vectors.shape().rank() - 1, i, i + 1); }

/// Two unit vectors [R,3] across unit directions and each other (Duff et al., Building an Orthonormal Basis, 2017).
struct Across {
  Tensor u, v;
};
Across across(const Tensor& directions) {
  const Tensor x = part(directions, 0), y = part(directions, 1), z = part(directions, 2);
  const Tensor s = where(z < 0.f, Tensor(-1.f), Tensor(1.f)), a = -1.f / (s + z), b = x * y * a;
  return {concat({s * x * x * a + 1.f, s * b, -(s * x)}, 1), concat({b, y * y * a + s, -y}, 1)};
}

/// [R,1,1,3] of [R,3].
Tensor by_ray(const Tensor& vectors) { return unsqueeze(unsqueeze(vectors, 1), 1); }

/// At least 1, within the unit ball: smooth at its middle.
Tensor norms_from_one(const Tensor& points) {
  return sqrt(maximum(square(part(points, 0)) + square(part(points, 1)) + square(part(points, 2)), 1.f));
}

}  // namespace

ConeSamples six_samples(const Cones& cones, const Tensor& edges, const ConeTurn& turn) {
  const Pieces at = pieces_of(edges);
  const Tensor m = square(at.middle), d = square(at.half);
  const Tensor lead = square(at.end) + 2.f * m, reach = sqrt(square(d - m) + 4.f * square(m));
  const Tensor unit = at.half / maximum(d + 3.f * m, 1e-20f);
  std::vector<float> places;
  for (int64_t j = 0; j < kSix; j++)
    places.push_back(3 / std::sqrt(7.f) * (2 * static_cast<float>(j) / (kSix - 1) - 1));
  const Tensor t = unsqueeze(at.begin, 2) +
                   unsqueeze(unit, 2) * (unsqueeze(lead, 2) + unsqueeze(reach, 2) * from_host(places, {1, 1, kSix}));
  const Tensor sixths = from_host(kAngles, {1, 1, kSix}) * (1.f / kSix), flip = unsqueeze(turn.flip, 2);
  const Tensor angles = (sixths + flip * (5.f / 6 - 2.f * sixths) + unsqueeze(turn.spin, 2)) * kTurn;
  const Tensor side = reshape(cones.radii, {cones.radii.dim(0), 1, 1}) * t * std::sqrt(0.5f);
  const Across basis = across(cones.rays.directions);
  const auto along = [](const Tensor& lengths, const Tensor& vectors) {
    return unsqueeze(lengths, 3) * by_ray(vectors);
  };
  return {by_ray(cones.rays.origins) + along(t, cones.rays.directions) + along(side * cos(angles), basis.u) +
              along(side * sin(angles), basis.v),
          side * kWidthShare};
}

ConeTurn still_turn(int64_t pieces) {
  std::vector<float> odd;
  for (int64_t i = 0; i < pieces; i++) odd.push_back(static_cast<float>(i % 2));
  const Tensor is = from_host(odd, {1, pieces});
  return {is * (-1.f / 12), is};
}

ConeSamples one_sample(const Cones& cones, const Tensor& edges) {
  const Pieces at = pieces_of(edges);
  const Tensor m = square(at.middle), d = square(at.half);
  const Tensor t = unsqueeze(at.middle + 2.f * at.middle * d / maximum(3.f * m + d, 1e-20f), 2);
  return {by_ray(cones.rays.origins) + unsqueeze(t, 3) * by_ray(cones.rays.directions),
          reshape(cones.radii, {cones.radii.dim(0), 1, 1}) * t * 0.5f};
}

ConeSamples contracted(const ConeSamples& samples) {
  const Tensor far = norms_from_one(samples.points), flat = reshape(far, samples.widths.shape());
  // |dx'/dx| along the ray from the middle is 1 / r^2, across it (2 - 1/r) / r, twice.
  return {samples.points * ((2.f - 1.f / far) / far), samples.widths * pow(2.f * flat - 1.f, 2.f / 3.f) / square(flat)};
}

Tensor uncontracted(const Tensor& points) {
  const Tensor norm = norms_from_one(points);
  return points / maximum((2.f - norm) * norm, 1e-6f);
}

ConeSamples in_unit_cube(const ConeSamples& samples, bool is_contracted) {
  const float scale = is_contracted ? 0.25f : 0.5f;
  return {clamp(samples.points * scale + 0.5f, 0.f, 1.f), samples.widths * scale};
}

}  // namespace cloam
