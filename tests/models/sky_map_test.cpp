// The sky of a street of gaussians: a cube map, and what it begins with.
#include "models/splat/sky_map.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/io/host_random.h"
#include "models/scene/pose.h"
#include "models/splat/sky_start.h"
#include "runtime/ops.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// Directions through the centres of the texels of the face at +y, row by row.
std::vector<float> directions_ahead(int side) {
  std::vector<float> directions;
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column)
      for (const float way : {2 * (static_cast<float>(column) + 0.5f) / static_cast<float>(side) - 1, 1.f,
                              2 * (static_cast<float>(row) + 0.5f) / static_cast<float>(side) - 1})
        directions.push_back(way);
  return directions;
}

}  // namespace

TEST_CASE("the sky's faces are where directions find them, and meet at their edges") {
  // Faces that show the direction itself: bilinear reading of a linear map gives it back.
  const int64_t side = 64;
  std::vector<float> faces;
  for (int face = 0; face < 6; ++face)
    for (int64_t row = 0; row < side; ++row)
      for (int64_t column = 0; column < side; ++column) {
        const auto way = [&](int64_t at) { return 2 * (static_cast<float>(at) + 0.5f) / side - 1; };
        const int axis = face / 2;
        std::vector<float> d(3);
        d[static_cast<size_t>(axis)] = face % 2 == 0 ? 1.f : -1.f;
        d[axis == 0 ? 1 : 0] = way(column);
        d[axis == 2 ? 1 : 2] = way(row);
        faces.insert(faces.end(), d.begin(), d.end());
      }
  HostRandom random(4);
  const Eigen::Matrix4d eye = pose_from(turn_about_z(0.3) * Eigen::AngleAxisd(0.2, Vector3d::UnitX()), {0.4, -0.2, -6});
  std::vector<float> directions, expected;
  for (int i = 0; i < 400; ++i) {
    Vector3d d(random.between(-1, 1), random.between(-1, 1), random.between(-1, 1));
    if (i == 0) d = {2, 0, 0};
    for (int k = 0; k < 3; ++k) {
      directions.push_back(static_cast<float>(eye.col(k).head<3>().dot(d)));
      expected.push_back(static_cast<float>(d[k] / d.cwiseAbs().maxCoeff()));
    }
  }
  const Tensor found =
      transpose(sky_colours(from_host(faces, {6, side, side, 3}), from_host(directions, {400, 3}), eye));
  CHECK(max(abs(found - from_host(expected, {400, 3}))).item() < 1.01f / side);  // beside an edge, half a pixel
}

TEST_CASE("the sky begins with what photos show, and what none shows takes on what lies around it") {
  constexpr int side = 16, count = side * side;
  const auto colour = [](int row, int column, int channel) {
    return static_cast<uint8_t>(40 + 8 * row + 3 * column + 5 * channel);
  };
  std::vector<uint8_t> rgba;
  std::vector<float> weights;
  const auto in_hole = [](int row, int column) { return row >= 5 && row < 11 && column >= 4 && column < 10; };
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column) {
      for (int channel = 0; channel < 3; ++channel)
        rgba.push_back(in_hole(row, column) ? 255 : colour(row, column, channel));
      rgba.push_back(255);
      weights.push_back(in_hole(row, column) ? 0.f : 1.f);
    }
  const Tensor taps =
      nearest_taps(sky_taps(from_host(directions_ahead(side), {count, 3}), Eigen::Matrix4d::Identity(), side));
  SkyStart sky(side);
  sky.add(rgba, weights, taps);
  // The same texel in another photo, where it counts a third as much.
  std::vector<uint8_t> other(4 * count, 0);
  std::vector<float> rarely(count, 0.f);
  rarely[3] = 1.f / 3;
  sky.add(other, rarely, taps);
  const std::vector<float> faces = sky.faces(0.5f).to_host();
  REQUIRE(faces.size() == 6 * 3 * count);
  const auto found = [&](int face, int row, int column, int channel) {
    return faces[static_cast<size_t>(((face * side + row) * side + column) * 3 + channel)];
  };
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column)
      for (int channel = 0; channel < 3; ++channel) {
        CAPTURE(row);
        CAPTURE(column);
        const float truth =
            static_cast<float>(colour(row, column, channel)) / 255 * (row == 0 && column == 3 ? 0.75f : 1.f);
        const float within = in_hole(row, column) ? 0.08f : 1e-6f;  // of a range of 0.65
        CHECK(std::abs(found(2, row, column, channel) - truth) < within);
        // A side that no photo shows is as the others are at that height, above and below as they end.
        float mean = 0, known = 0;
        for (int beside = 0; beside < side; ++beside) {
          if (in_hole(row, beside)) continue;
          mean += found(2, row, beside, channel);
          ++known;
        }
        for (const int face : {0, 1, 3}) CHECK(found(face, row, column, channel) == doctest::Approx(mean / known));
        if (row == side - 1) CHECK(found(4, 5, column, channel) == doctest::Approx(mean / known));
        if (row == 0) CHECK(found(5, 5, column, channel) == doctest::Approx(mean / known));
      }
  CHECK(max(abs(SkyStart(side).faces(0.5f) - 0.5f)).item() == 0);
}
