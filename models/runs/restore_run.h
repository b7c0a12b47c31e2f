// A trained model from its run folder.
#pragma once
#include <functional>
#include <memory>

#include "models/io/checkpoint.h"
#include "models/latents/new_assets.h"
#include "models/methods/registry.h"
#include "models/runs/run_folder.h"
#include "models/train/learns_from_run.h"
#include "models/train/trainer.h"

namespace cloam {

/// What lies in a run folder.
struct StoredRun {
  std::filesystem::path folder;
  RunRecord record;
  Scenes scenes;                // the geometry that the model was fitted to; no images
  LoadedCheckpoint checkpoint;  // without a path: changed since it was read
  NewAssets generated;          // of an edited run: assets that actors wear as added_asset(scenes.size(), place)
};

/// Reads the record, the geometry, the newest whole checkpoint and generated assets.
/// Fault::usage for a folder that does not exist; Fault::data for what is damaged or does not fit together.
StoredRun read_run(const std::filesystem::path& folder);

/// Method, step and checksum of the parameters: equal after copying the run, another one after training it further.
std::string fingerprint(const StoredRun& run);

/// The run that a run learned from, where it lies now. Fault::data if it is gone or was changed since.
StoredRun read_source(const StoredRun& run);

struct RestoredRun : StoredRun {
  std::unique_ptr<Method> method;
  Progress progress;
};

/// read_source, and its method is given what it says: nothing is generated before.
StoredRun load_source(const RestoredRun& run);

/// read_run, with the method built from it and given the generated assets; `edit` may change the scenes
/// before: where actors are, not how many. Errors as read_run.
RestoredRun restore_run(
    const std::filesystem::path& folder, const std::function<void(Scenes&)>& edit = [](Scenes&) {});
RestoredRun restore_run(StoredRun stored);

/// The run as methods take it that learn from runs; refers to its scenes.
SourceRun source_of(const StoredRun& run);

/// What a checkpoint says about the model that it belongs to.
std::map<std::string, std::string> checkpoint_metadata(const RunRecord& record);

/// Fault::data naming the first entry of a checkpoint that is not of this run.
void check_belongs(const LoadedCheckpoint& checkpoint, const RunRecord& record);

/// Does its method learn from a run (LearnsFromRun)? Then it has no views and no actors of its own. No error for a
/// method that this version does not know: whoever restores the run tells.
bool learned_from_run(const RunRecord& record);
/// Fault::usage for such a run.
void check_has_views(const RunRecord& record);
/// Fault::usage for any other.
void check_is_prior(const RunRecord& record, const std::filesystem::path& folder);

/// "full" or "mixed": what train --precision was.
std::string precision_of(const RunRecord& record);

/// A method with the settings of the record, not built; `config` lists them.
std::unique_ptr<Method> configured_method(const RunRecord& record, Config& config);

}  // namespace cloam
