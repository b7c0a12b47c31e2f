// How near a street's LiDAR returns come to those that were recorded.
#pragma once
#include <vector>

#include "models/runs/listener.h"
#include "models/street/lidar_rays.h"
#include "models/train/ranks.h"

namespace cloam {

struct LidarScores {
  std::vector<double> errors;   // metres, a ray each
  std::vector<double> chamfer;  // square metres, a sweep each
  // Of streets that know them: the recorded intensity of each return and the squared error, and how likely it was held
  // that a return, or a missing ray, is missing.
  std::vector<double> intensities = {}, intensity_errors = {}, drops = {}, missing_drops = {};

  /// NaN of none.
  double median_error() const;
  double mean_chamfer() const;
  double intensity_rmse() const;
  /// Of the mean intensity for all returns.
  double mean_intensity_rmse() const;
  /// The share of rays of which it is rightly told whether they come back; of returns and of missing rays with equal
  /// weights; and the share of whichever are more. NaN without rays of both kinds.
  double drop_accuracy() const;
  double balanced_drop_accuracy() const;
  double usual_drop_share() const;
  void add(const LidarScores& more);
};

/// errors: |measured - recorded|; a ray on which the street has nothing counts with its whole depth. chamfer: of the
/// points at the measured depths and the recorded ones, the squared distances to the nearest of the other set, summed
/// up over both sets and divided by the number of recorded points (ChamferSums::by_target); a ray on which the street
/// has nothing has no point. Infinite where no ray has one.
LidarScores lidar_scores(const MeasuredSweep& sweep);
/// Of the scene's test sweeps that have a return, which ranks share. Fault::data for damaged sweeps.
LidarScores lidar_scores(Street& street, const Scene& scene, int index, const Ranks& ranks, const Listener& listener);

}  // namespace cloam
