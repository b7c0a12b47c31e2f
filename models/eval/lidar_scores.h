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

  /// NaN of none.
  double median_error() const;
  double mean_chamfer() const;
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
