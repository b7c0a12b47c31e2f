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

constexpr std::vector<double> LidarScores::*kLists[] = {&LidarScores::errors,      &LidarScores::chamfer,
                                                        &LidarScores::intensities, &LidarScores::intensity_errors,
                                                        &LidarScores::drops,       &LidarScores::missing_drops};

double mean_of(const std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double above_half(const std::vector<double>& values) {
  return static_cast<double>(std::count_if(values.begin(), values.end(), [](double value) { return value > 0.5; }));
}

/// Rays of either kind, and those of them that are told rightly.
struct DropCounts {
  double returned, missing, told, told_missing;
};

/// NaN without rays of both kinds.
DropCounts drop_counts(const LidarScores& of) {
  const auto returned = static_cast<double>(of.drops.size()), missing = static_cast<double>(of.missing_drops.size());
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (of.drops.empty() || of.missing_drops.empty()) return {kNone, kNone, kNone, kNone};
  return {returned, missing, returned - above_half(of.drops), above_half(of.missing_drops)};
}

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
  for (std::size_t i = 0; i < sweep.intensities.size(); ++i) {
    scores.intensities.push_back(double{sweep.recorded.intensities[i]});
    scores.intensity_errors.push_back(std::pow(double{sweep.intensities[i]} - scores.intensities.back(), 2));
  }
  scores.drops.assign(sweep.drops.begin(), sweep.drops.end());
  scores.missing_drops.assign(sweep.missing_drops.begin(), sweep.missing_drops.end());
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
    nlohmann::ordered_json made = nlohmann::ordered_json::array();
    for (const auto list : kLists) made.push_back(packed(scores.*list));
    return made;
  };
  const auto complete = [&](std::size_t done) {
    return text(done, " of ", sweeps.size(), " sweeps were measured; no metrics were written");
  };
  LidarScores all;
  for (const auto& made : share_out(ranks, listener, {sweeps.size(), make, complete})) {
    LidarScores one;
    for (std::size_t i = 0; i < std::size(kLists); ++i) one.*kLists[i] = unpacked<double>(made.at(i));
    all.add(one);
  }
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

double LidarScores::mean_chamfer() const { return mean_of(chamfer); }

double LidarScores::intensity_rmse() const { return std::sqrt(mean_of(intensity_errors)); }

double LidarScores::mean_intensity_rmse() const {
  const double mean = mean_of(intensities);
  std::vector<double> errors_of_mean;
  for (const double value : intensities) errors_of_mean.push_back(std::pow(value - mean, 2));
  return std::sqrt(mean_of(errors_of_mean));
}

double LidarScores::drop_accuracy() const {
  const auto [returned, missing, told, told_missing] = drop_counts(*this);
  return (told + told_missing) / (returned + missing);
}

double LidarScores::balanced_drop_accuracy() const {
  const auto [returned, missing, told, told_missing] = drop_counts(*this);
  return 0.5 * (told / returned + told_missing / missing);
}

double LidarScores::usual_drop_share() const {
  const DropCounts counts = drop_counts(*this);
  return std::max(counts.returned, counts.missing) / (counts.returned + counts.missing);
}

void LidarScores::add(const LidarScores& more) {
  for (const auto list : kLists) (this->*list).insert((this->*list).end(), (more.*list).begin(), (more.*list).end());
}

}  // namespace cloam
