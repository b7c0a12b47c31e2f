// Looks that come from another run.
#pragma once
#include <filesystem>
#include <string>

#include "models/runs/restore_run.h"
#include "models/scene/edit.h"

namespace cloam {

/// Where "RUN:[LOG:]ID" names the run; empty: there is no run of such a name.
std::filesystem::path run_named_in(const std::string& operand);

/// The looks of an actor of another run become part of this one: in its parameters, and in its first log as one more
/// actor without boxes, whose appearance others can take. Opens both runs' methods: the device must be. Fault::usage
/// where either method has no gaussians of its own for actors; Fault::data for an actor that has none.
Replace adopt_actor(StoredRun& run, const StoredRun& other, const AssetName& name);

}  // namespace cloam
