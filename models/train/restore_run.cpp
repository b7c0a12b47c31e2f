// See restore_run.h.
#include "models/train/restore_run.h"

#include "models/methods/registry.h"
#include "models/train/scene_file.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kSetting[] = "setting.";

}  // namespace

std::map<std::string, std::string> checkpoint_metadata(const RunRecord& record) {
  std::map<std::string, std::string> metadata = {{"method", record.method}, {"preset", record.preset}};
  for (const auto& [key, value] : record.settings) metadata[kSetting + key] = value;
  return metadata;
}

void check_belongs(const LoadedCheckpoint& checkpoint, const RunRecord& record) {
  std::map<std::string, std::string> wanted = checkpoint_metadata(record);
  wanted["seed"] = std::to_string(record.seed);
  for (const auto& [key, value] : wanted) {
    const auto found = checkpoint.file.metadata.find(key);
    const bool known = found != checkpoint.file.metadata.end();
    if (known && found->second == value) continue;
    throw Error(Fault::data, text("the checkpoint ", checkpoint.path.string(), " is not of this run: its ", key, " is ",
                                  known ? found->second.substr(0, 80) : "missing", ", the run has ", value,
                                  ".\n  fix: put the run's own checkpoint back, or train anew"));
  }
}

std::unique_ptr<Method> configured_method(const RunRecord& record, Config& config) {
  try {
    auto method = make_method(record.method);
    method->configure(config);
    for (const auto& [key, value] : record.settings) config.set(key, value, "run.json");
    return method;
  } catch (const Error& error) {
    throw Error(Fault::data, text("the run does not fit this version of the program: ", error.what()));
  }
}

RestoredRun restore_run(const std::filesystem::path& folder, const std::function<void(Scenes&)>& edit) {
  RestoredRun run;
  run.record = read_record(folder);
  const RunPaths paths{folder};
  run.scenes = read_scene_file(paths.scene());
  edit(run.scenes);
  run.checkpoint = load_latest_checkpoint(paths.checkpoints());
  check_belongs(run.checkpoint, run.record);
  Config config;
  run.method = configured_method(run.record, config);
  run.method->build(run.scenes, run.record.seed);
  run.progress = restore_method(*run.method, run.checkpoint.file);
  return run;
}

}  // namespace cloam
