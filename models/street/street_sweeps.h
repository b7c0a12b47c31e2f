// What a street learns from its LiDAR before training: the voxels of its space, and which sweeps have returns. Both are
// computed once and kept in the data cache; of the sweeps themselves, memory holds those that steps ask for.
#pragma once
#include "models/street/street_space.h"

namespace cloam {

/// The sweeps of the training split; `space` has looked at them afterwards. store: where their points are held; null:
/// in memory, all of them, and nothing is kept. Touches no device, so that several
/// logs can be looked at at once. Fault::data for a sweep that is damaged.
LogSweeps training_sweeps(const RestingScene& scene, StreetSpace& space, const std::shared_ptr<HostStore>& store);

}  // namespace cloam
