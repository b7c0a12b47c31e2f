// The Gaussians of a run as solid ellipsoids.
#pragma once
#include "models/runs/restore_run.h"
#include "models/scene/view.h"

namespace cloam {

/// Whether the run's method has Gaussians to show.
bool has_ellipsoids(const RestoredRun& run);

/// ellipsoid_picture() of all that a run of Gaussians shows at the view's time, actors where they are then; one
/// standard deviation large, without those of an opacity below 0.2, which would hide what is behind them as well as
/// solid ones.
Picture ellipsoids_seen(const RestoredRun& run, const View& view);

}  // namespace cloam
