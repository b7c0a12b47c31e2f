// Average precision of detected boxes by the distance of their centres on the ground, as nuScenes measures it (Caesar
// et al. 2020, section 3.3). A box that is found twice counts once; the other one is a false alarm.
#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

namespace cloam {

/// Boxes of one class. sample: the moment (a log and its step) that it is seen at; only boxes of one moment can match.
struct TrueBox {
  int sample = 0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // metres on the ground
};
struct DetectedBox {
  int sample = 0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double score = 0;  // larger: surer
};

constexpr int kRecalls = 101;  // 0, 0.01 to 1

/// The precision at each recall. By falling score (of equal ones the last first, as nuScenes has them), a detection
/// takes the nearest true box that none has taken, if that is less than `distance` metres away; else it is a false
/// alarm. Between recalls that are reached precision is linear, beyond the last it is 0; all 0 where nothing matches.
/// Fault::data for a score or a centre that is not finite.
std::array<double, kRecalls> precision_curve(const std::vector<DetectedBox>& detected,
                                             const std::vector<TrueBox>& truth, double distance);

/// The mean of max(0, precision - 0.1) / 0.9 over recalls above 0.1: noise at the ends does not count. NaN without a
/// true box.
double average_precision(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth, double distance);

/// average_precision at each distance, and their mean. GenAssets takes 1, 2 and 4 m; nuScenes takes 0.5 m, too.
struct DistancePrecision {
  std::vector<double> at;
  double mean = 0;
};
DistancePrecision distance_precision(const std::vector<DetectedBox>& detected, const std::vector<TrueBox>& truth,
                                     const std::vector<double>& distances = {1, 2, 4});

}  // namespace cloam
