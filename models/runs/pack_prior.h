// A diffusion of assets' codes and the networks that decode them, made small enough to hand on: what `export --format
// prior` writes, and what the program ships.
#pragma once
#include <filesystem>

#include "models/runs/restore_run.h"

namespace cloam {

/// Two run folders in half precision, FOLDER/networks and FOLDER/assets. `networks` has the networks of the run that
/// `prior` learned from, and its actors that were seen, in their order, as galleries: logs of one time of day each,
/// with codes and boxes but without images, sweeps, trajectories and background. `assets` has the diffusion with the
/// EMA of its weights. Both are for generating, fitting (--networks, --prior) and augmenting, not for training further.
/// Fault::usage if `prior` is a run of another method, or FOLDER is not empty; Fault::data as read_source and
/// asset_codes.
void pack_prior(const StoredRun& prior, const std::filesystem::path& folder);

}  // namespace cloam
