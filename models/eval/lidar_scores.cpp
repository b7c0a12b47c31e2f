// See lidar_scores.h.
#include "models/eval/lidar_scores.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "models/metrics/chamfer.h"
#include "models/runs/shared_work.h"
#include "runtime/error.h"

namespace cloam {
namespace {

/// x y z of each ray's end, of those that have one.
std::vector<float> ends_of(const WorldRays& rays, const std::vector<float>& depths) {
  std::vector<float> points;
  for (std::size_t i = 0; i < depths.size(); ++i)
    for (std::size_t axis = 0; axis < 3 && depths[i] > 0; ++axis)
      points.push_back(rays.origins[3 * i + axis] + depths[i] * rays.directions[3 * i + axis]);
  return points;
}

}  // namespace

LidarScores lidar_scores(const MeasuredSweep& sweep) {
  LidarScores scores;
  const std::vector<float>& recorded = sweep.recorded.depths;
  for (std::size_t i = 0; i < recorded.size(); ++i)
    scores.errors.push_back(std::abs(double{sweep.depths[i]} - double{recorded[i]}));
  const WorldRays& rays = sweep.recorded.rays;
  scores.chamfer.push_back(chamfer(ends_of(rays, sweep.depths), ends_of(rays, recorded)).by_target());
  return scores;
}

LidarScores lidar_scores(Street& street, const Scene& scene, int index, const Ranks& ranks, const Listener& listener) {
  std::vector<const Sweep*> sweeps;
  for (const Sweep& sweep : scene.sweeps)
    if (sweep.split == Split::test) sweeps.push_back(&sweep);
  const auto make = [&](std::size_t item) {
    const std::optional<MeasuredSweep> measured = measured_sweep(street, scene, *sweeps[item], index);
    const LidarScores scores = measured ? lidar_scores(*measured) : LidarScores();
    return nlohmann::ordered_json::array({packed(scores.errors), packed(scores.chamfer)});
  };
  const auto complete = [&](std::size_t done) {
    return text(done, " of ", sweeps.size(), " sweeps were measured; no metrics were written");
  };
  LidarScores all;
  for (const auto& made : share_out(ranks, listener, {sweeps.size(), make, complete}))
    all.add({unpacked<double>(made.at(0)), unpacked<double>(made.at(1))});
  return all;
}

double LidarScores::median_error() const {
  if (errors.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::vector<double> values = errors;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double LidarScores::mean_chamfer() const {
  if (chamfer.empty()) return std::numeric_limits<double>::quiet_NaN();
  return std::accumulate(chamfer.begin(), chamfer.end(), 0.0) / static_cast<double>(chamfer.size());
}

void LidarScores::add(const LidarScores& more) {
  errors.insert(errors.end(), more.errors.begin(), more.errors.end());
  chamfer.insert(chamfer.end(), more.chamfer.begin(), more.chamfer.end());
}

}  // namespace cloam
