// Evaluation of runs that learned from the assets of another run: how well noise is told from assets held out.
#pragma once
#include <nlohmann/json_fwd.hpp>

#include "models/eval/photo_crops.h"
#include "models/nn/feature_network.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"
#include "models/train/ranks.h"

namespace cloam {

/// What samples are looked at through, and held against; both may be missing.
struct PriorReferences {
  const FeatureNetwork* network = nullptr;
  const PhotoCrops* photos = nullptr;  // need a network
};

/// Measures a run of diffusion and writes its eval/eval.json; returns what `eval --json` prints. With a network also
/// how its samples look; ranks share these. Fault::data if the run that it learned from is gone or was changed, and for
/// photos that nothing can be measured by.
nlohmann::ordered_json measure_prior(const RestoredRun& run, const PriorReferences& by, const Listener& listener,
                                     const Ranks& ranks = alone());

}  // namespace cloam
