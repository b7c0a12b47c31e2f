// A LiDAR's sweep as rays, and how far a model's depths are from what the sweep says.
#pragma once
#include "models/data/load_sweep.h"
#include "models/street/street.h"

namespace cloam {

/// From the LiDAR's place at the sweep to each return of the LiDAR that turns (that of the one that looks ahead stands
/// elsewhere, and no one says where); of all, if there is no such return.
struct SweepRays {
  WorldRays rays;
  std::vector<float> depths;  // [R] metres, as recorded
};
SweepRays sweep_rays(const Sweep& sweep, const LidarPoints& points, int scene);

/// Every n-th ray, n the least that leaves at most this many.
SweepRays thinned(const SweepRays& rays, std::size_t most);

/// |measured - recorded| in metres of the returns of the scene's test sweeps, at most 20,000 a sweep. A ray on which
/// the street has nothing counts with its whole depth. Fault::data for damaged sweeps.
std::vector<double> lidar_errors(Street& street, const Scene& scene, int index);

/// NaN of none.
double median_error(std::vector<double> values);

}  // namespace cloam
