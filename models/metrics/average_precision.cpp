// See average_precision.h.
#include "models/metrics/average_precision.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kFirstRecall = 11;  // the first above 0.1
constexpr double kLeastPrecision = 0.1;

void need_finite(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth) {
  for (const TrueBox& box : truth)
    if (!box.centre.allFinite()) bad_data("average precision: a true box's centre is not finite");
  for (const DetectedBox& box : detected)
    if (!box.centre.allFinite() || !std::isfinite(box.score))
      bad_data("average precision: a detected box's centre or score is not finite");
}

std::vector<size_t> by_falling_score(const std::vector<DetectedBox>& detected) {
  std::vector<size_t> order(detected.size());
  std::iota(order.rbegin(), order.rend(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return detected[a].score > detected[b].score; });
  return order;
}

/// Which detections, by falling score, find a true box.
std::vector<bool> matches(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth,
                          double distance) {
  std::map<int, std::vector<size_t>> left;  // by sample: boxes that none has taken
  for (size_t i = 0; i < truth.size(); i++) left[truth[i].sample].push_back(i);
  std::vector<bool> found;
  for (const size_t number : by_falling_score(detected)) {
    const DetectedBox& box = detected[number];
    auto& boxes = left[box.sample];
    const auto away = [&](size_t i) { return (truth[i].centre - box.centre).norm(); };
    const auto nearest =
        std::min_element(boxes.begin(), boxes.end(), [&](size_t a, size_t b) { return away(a) < away(b); });
    found.push_back(nearest != boxes.end() && away(*nearest) < distance);
    if (found.back()) boxes.erase(nearest);
  }
  return found;
}

struct Reached {
  std::vector<double> recall, precision;  // after each detection

  double precision_at(double wanted) const {
    if (recall.empty() || wanted > recall.back()) return 0;
    const auto next = std::upper_bound(recall.begin(), recall.end(), wanted);  // of equal recalls the last counts
    if (next == recall.begin()) return precision.front();
    const auto i = static_cast<size_t>(next - recall.begin()) - 1;
    if (next == recall.end()) return precision[i];
    return std::lerp(precision[i], precision[i + 1], (wanted - recall[i]) / (*next - recall[i]));
  }
};

}  // namespace

std::array<double, kRecalls> precision_curve(const std::vector<DetectedBox>& detected,
                                             const std::vector<TrueBox>& truth, double distance) {
  need_finite(detected, truth);
  Reached reached;
  double right = 0, all = 0;
  for (const bool match : matches(detected, truth, distance)) {
    right += match, all += 1;
    reached.recall.push_back(right / static_cast<double>(truth.size()));
    reached.precision.push_back(right / all);
  }
  std::array<double, kRecalls> curve{};
  if (right == 0) return curve;
  // i * 0.01 and not i / 100: nuScenes' numbers, to the last bit, decide which recalls are beyond the last.
  for (size_t i = 0; i < curve.size(); i++) curve[i] = reached.precision_at(static_cast<double>(i) * 0.01);
  return curve;
}

double average_precision(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth, double distance) {
  if (truth.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto curve = precision_curve(detected, truth, distance);
  double sum = 0;
  for (size_t i = kFirstRecall; i < curve.size(); i++) sum += std::max(0.0, curve[i] - kLeastPrecision);
  return sum / (kRecalls - kFirstRecall) / (1 - kLeastPrecision);
}

DistancePrecision distance_precision(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth,
                                     const std::vector<double>& distances) {
  DistancePrecision result;
  for (const double distance : distances) result.at.push_back(average_precision(detected, truth, distance));
  result.mean = std::accumulate(result.at.begin(), result.at.end(), 0.0) / static_cast<double>(distances.size());
  return result;
}

}  // namespace cloam
