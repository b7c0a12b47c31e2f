// See restore_run.h.
#include "models/runs/restore_run.h"

#include <algorithm>
#include <utility>

#include "models/io/crc32c.h"
#include "models/latents/shows_assets.h"
#include "models/runs/scene_file.h"
#include "models/train/mixed_precision.h"
#include "models/train/old_names.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kSetting[] = "setting.";

/// Whoever wears another asset names one that there is.
void check_looks(const StoredRun& run) {
  const std::size_t all = run.scenes.size() + run.generated.assets.size();
  for (const Scene& scene : run.scenes)
    for (const Actor& actor : scene.actors)
      if (actor.asset && static_cast<std::size_t>(actor.asset->scene) >= all)
        throw Error(Fault::data,
                    text(run.folder.string(), ": actor ", actor.id, " uses generated asset ",
                         static_cast<std::size_t>(actor.asset->scene) - run.scenes.size(), ", but the run has ",
                         run.generated.assets.size(), "\n  fix: make the edited run anew"));
}

/// Gives a restored run the assets that were generated for it.
void add_generated(const RestoredRun& run) {
  if (run.generated.assets.empty()) return;
  auto* shows = as<ShowsAssets>(*run.method);
  if (!shows)
    throw Error(Fault::data, text(run.folder.string(), " holds generated assets, but its method, ", run.record.method,
                                  ", knows no actors"));
  (void)shows->show_assets(run.generated.assets);
}

}  // namespace

std::map<std::string, std::string> checkpoint_metadata(const RunRecord& record) {
  std::map<std::string, std::string> metadata = {{"method", record.method}, {"preset", record.preset}};
  for (const auto& [key, value] : record.settings) metadata[kSetting + key] = value;
  return metadata;
}

void check_belongs(const LoadedCheckpoint& checkpoint, const RunRecord& record) {
  std::map<std::string, std::string> wanted = checkpoint_metadata(record), held;
  wanted["seed"] = std::to_string(record.seed);
  for (const auto& [key, value] : checkpoint.file.metadata)
    held[key.starts_with(kSetting) ? kSetting + current_setting(key.substr(std::string(kSetting).size())) : key] =
        value;
  for (const auto& [key, value] : wanted) {
    const auto found = held.find(key);
    const bool known = found != held.end();
    if (known && found->second == value) continue;
    throw Error(Fault::data, text("the checkpoint ", checkpoint.path.string(), " does not belong to this run: its ",
                                  key, " is ", known ? found->second.substr(0, 80) : "missing", ", the run has ", value,
                                  ".\n  fix: put the run's own checkpoint back, or train anew"));
  }
}

std::string precision_of(const RunRecord& record) {
  const auto mixed = record.settings.find(kMixedPrecision);
  return mixed != record.settings.end() && mixed->second == "true" ? "mixed" : "full";
}

std::unique_ptr<Method> configured_method(const RunRecord& record, Config& config) {
  try {
    auto method = make_method(record.method);
    method->configure(config);
    for (const auto& [key, value] : record.settings) config.restore(key, value, "run.json");
    return method;
  } catch (const Error& error) {
    throw Error(Fault::data, text("the run does not fit this version of the program: ", error.what()));
  }
}

bool learned_from_run(const RunRecord& record) { return has<LearnsFromRun>(record.method); }

void check_has_views(const RunRecord& record) {
  if (!learned_from_run(record)) return;
  throw Error(Fault::usage,
              text("a run of ", record.method, " has no views and no actors: cloam generate makes assets ",
                   "with it, or name the run it learned from, ", record.data.front().given));
}

void check_is_prior(const RunRecord& record, const std::filesystem::path& folder) {
  if (learned_from_run(record)) return;
  throw Error(Fault::usage,
              text(folder.string(), " is a run of ", record.method, "; new assets come from a run of diffusion",
                   record.method == "genassets"
                       ? text("\n  fix: cloam train diffusion ", folder.string(), " -o RUN2, and name RUN2")
                       : "\n  fix: leave RUN out to use the one that comes with the program, or train one on a "
                         "genassets run"));
}

StoredRun read_run(const std::filesystem::path& folder) {
  StoredRun run;
  run.folder = folder;
  run.record = read_record(folder);
  const RunPaths paths{folder};
  run.scenes = read_scene_file(paths.scene());
  run.checkpoint = load_latest_checkpoint(paths.checkpoints());
  check_belongs(run.checkpoint, run.record);
  std::error_code error;
  if (std::filesystem::exists(paths.generated(), error)) run.generated = read_new_assets(paths.generated());
  check_looks(run);
  return run;
}

std::string fingerprint(const StoredRun& run) {
  uint32_t sum = 0;
  for (const auto& [name, tensor] : parameters_in(run.checkpoint.file)) sum = crc32c(tensor.data, sum);
  return text(run.record.method, ", step ", run.checkpoint.step, ", ", crc32c_digits(sum));
}

StoredRun read_source(const StoredRun& run) {
  const RunData& data = run.record.data.front();
  StoredRun source = read_run(find_data(run.folder, data));
  const std::string now = fingerprint(source);
  if (now == data.fingerprint) return source;
  throw Error(Fault::data, text(source.folder.string(), " is not what ", run.folder.string(), " learned from (",
                                data.fingerprint, "; now ", now, ")\n  fix: train it anew, or put that run back"));
}

StoredRun load_source(const RestoredRun& run) {
  StoredRun source = read_source(run);
  require<LearnsFromRun>(*run.method, run.record.method, "generating assets").load(source_of(source));
  return source;
}

SourceRun source_of(const StoredRun& run) {
  SourceRun source{run.folder,
                   run.record.method,
                   run.record.settings,
                   {},
                   run.scenes,
                   parameters_in(run.checkpoint.file),
                   row_steps_in(run.checkpoint.file)};
  if (run.record.edited_from) source.edited_from = run.record.edited_from->given;
  return source;
}

RestoredRun restore_run(StoredRun stored) {
  RestoredRun run{std::move(stored), {}, {}};
  Config config;
  run.method = configured_method(run.record, config);
  run.method->build(run.scenes, run.record.seed);
  run.progress = restore_method(*run.method, run.checkpoint.file);
  add_generated(run);
  return run;
}

RestoredRun restore_run(const std::filesystem::path& folder, const std::function<void(Scenes&)>& edit) {
  StoredRun stored = read_run(folder);
  edit(stored.scenes);
  return restore_run(std::move(stored));
}

}  // namespace cloam
