// A LiDAR's sweep as rays, and how far a model's depths are from what the sweep says.
#pragma once
#include <optional>

#include "models/data/load_sweep.h"
#include "models/street/street.h"

namespace cloam {

/// From the LiDAR's place, when it saw it, to each return: of the LiDAR that turns, and of the one that looks ahead
/// where the log says where that stands; of all, if there is none of the former.
struct SweepRays {
  WorldRays rays;
  std::vector<float> depths;            // [R] metres, as recorded
  std::vector<float> intensities = {};  // [R], as recorded
};
SweepRays sweep_rays(const Sweep& sweep, const LidarPoints& points, int scene);

/// Every n-th ray, n the least that leaves at most this many.
SweepRays thinned(const SweepRays& rays, std::size_t most);
WorldRays every(const WorldRays& rays, std::size_t stride);

/// A sweep as it was recorded, and the depths that a street gives its rays.
struct MeasuredSweep {
  SweepRays recorded;
  std::vector<float> depths;  // 0: the street has nothing there
  // As LidarReturns; missing: of rays that sent nothing back (missing_rays). Empty: the street does not know them.
  std::vector<float> intensities = {}, drops = {}, missing_drops = {};
};
/// At most 20,000 returns of it, and as large a share of its missing rays; nothing for a sweep without any return.
/// Fault::data for a damaged one.
std::optional<MeasuredSweep> measured_sweep(Street& street, const Scene& scene, const Sweep& sweep, int index);

}  // namespace cloam
