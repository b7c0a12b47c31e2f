// A trained model from its run folder.
#pragma once
#include <functional>
#include <memory>

#include "models/io/checkpoint.h"
#include "models/train/run_folder.h"
#include "models/train/trainer.h"

namespace cloam {

struct RestoredRun {
  RunRecord record;
  Scenes scenes;  // the geometry that the model was fitted to; no images
  LoadedCheckpoint checkpoint;
  std::unique_ptr<Method> method;
  Progress progress;
};

/// Reads the record, the geometry and the newest whole checkpoint, and builds the method from them; `edit` may change
/// the scenes before: where actors are, not how many.
/// Fault::usage for a folder that does not exist; Fault::data for what is damaged or does not fit together.
RestoredRun restore_run(
    const std::filesystem::path& folder, const std::function<void(Scenes&)>& edit = [](Scenes&) {});

/// What a checkpoint says about the model that it belongs to.
std::map<std::string, std::string> checkpoint_metadata(const RunRecord& record);

/// Fault::data naming the first entry of a checkpoint that is not of this run.
void check_belongs(const LoadedCheckpoint& checkpoint, const RunRecord& record);

/// A method with the settings of the record, not built; `config` lists them.
std::unique_ptr<Method> configured_method(const RunRecord& record, Config& config);

}  // namespace cloam
