// Rays that nothing came back along, against a LiDAR whose pattern is known.
#include "models/street/missing_rays.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>

#include "models/eval/lidar_scores.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

struct Known {
  Sweep sweep;
  Recording recording;
  LidarPoints points;
  std::vector<Vector3d> missing, from;
};

/// Four beams of 180 columns, clockwise from the rear, of a LiDAR that moves on and stands askew; some send nothing
/// back.
Known turning_lidar(bool moving) {
  Known out;
  out.recording.sweep_seconds = moving ? 0.1 : 0;
  out.sweep.timestamp = 7;
  out.sweep.world_from_lidar.topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.7, Vector3d::UnitZ()).toRotationMatrix();
  out.sweep.world_from_lidar.topRightCorner<3, 1>() = Vector3d(20, -5, 2);
  if (moving) out.sweep.velocity = Vector3d(6, 8, 0);
  std::mt19937 random(5);
  for (const double up : {-20., -5., 0., 7.})
    for (int column = 0; column < 180; ++column) {
      const double share = (column + 0.5) / 180 - 0.5, turn = 2 * M_PI * share, e = up * M_PI / 180;
      const Vector3d way = out.sweep.world_from_lidar.topLeftCorner<3, 3>() *
                           Vector3d(std::sin(turn) * std::cos(e), std::cos(turn) * std::cos(e), std::sin(e));
      const double seconds = moving ? 0.1 * share : 0;
      const SeenFrom from = seen_from(out.sweep, 0, seconds);
      const bool is_lost = random() % 4 == 0 || (up == 7. && column > 40 && column < 90) || (up == 0. && column < 3);
      if (is_lost) {
        out.missing.push_back(way);
        out.from.push_back(from.origin);
        continue;
      }
      const Vector3d at = from.origin + (5 + 0.2 * (column % 50)) * way;
      for (const double value : at) out.points.positions.push_back(static_cast<float>(value));
      out.points.intensities.push_back(0.5f);
      out.points.times.push_back(static_cast<float>(seconds));
      out.points.sensors.push_back(0);
    }
  return out;
}

Vector3d vector_at(const std::vector<float>& values, std::size_t i) {
  return Eigen::Map<const Eigen::Vector3f>(&values[3 * i]).cast<double>();
}

}  // namespace

TEST_CASE("missing rays are those of the LiDAR's pattern that sent nothing back, from where and when they were sent") {
  for (const bool moving : {false, true}) {
    CAPTURE(moving);
    const Known known = turning_lidar(moving);
    const WorldRays found = missing_rays(known.recording, known.sweep, known.points, 3);
    CHECK(found.scene == 3);
    CHECK(found.time == 7);
    CHECK(found.times.empty() == !moving);
    REQUIRE(found.directions.size() == 3 * known.missing.size());
    for (std::size_t i = 0; i < known.missing.size(); ++i) {
      CAPTURE(i);
      double nearest = 9, off = 9;
      for (std::size_t k = 0; 3 * k < found.directions.size(); ++k) {
        const double apart = (vector_at(found.directions, k) - known.missing[i]).norm();
        if (apart < nearest) nearest = apart, off = (vector_at(found.origins, k) - known.from[i]).norm();
      }
      CHECK(nearest < 1e-3);  // columns are 0.035 apart
      CHECK(off < 1e-2);
    }
  }
  Known front = turning_lidar(false);
  front.recording.car = CarBox{{0, 0, -2}, {100, 100, 0.1}};  // beneath: all beams downwards meet it
  const WorldRays above = missing_rays(front.recording, front.sweep, front.points, 0);
  CHECK(above.directions.size() > 0);
  for (std::size_t i = 2; i < above.directions.size(); i += 3) CHECK(above.directions[i] > -0.09f);
}

TEST_CASE("scores of missing rays and intensities") {
  MeasuredSweep sweep;
  sweep.recorded.depths = {1, 2, 3, 4};
  sweep.recorded.intensities = {0.1f, 0.1f, 0.3f, 0.3f};
  sweep.recorded.rays.origins.assign(12, 0), sweep.recorded.rays.directions.assign(12, 0.5f);
  sweep.depths = {1, 2, 3, 4};
  sweep.intensities = {0.2f, 0.2f, 0.3f, 0.3f};
  sweep.drops = {0.1f, 0.2f, 0.4f, 0.6f};
  sweep.missing_drops = {0.9f, 0.2f};
  LidarScores scores = lidar_scores(sweep);
  CHECK(scores.intensity_rmse() == doctest::Approx(std::sqrt(0.005)));
  CHECK(scores.mean_intensity_rmse() == doctest::Approx(0.1));
  CHECK(scores.drop_accuracy() == doctest::Approx(4. / 6));
  CHECK(scores.balanced_drop_accuracy() == doctest::Approx((3. / 4 + 1. / 2) / 2));
  CHECK(scores.usual_drop_share() == doctest::Approx(4. / 6));
  scores.add(scores);
  CHECK(scores.drops.size() == 8);
  CHECK(scores.balanced_drop_accuracy() == doctest::Approx(0.625));
  CHECK(std::isnan(LidarScores{}.drop_accuracy()));
  CHECK(std::isnan(LidarScores{}.intensity_rmse()));
}
