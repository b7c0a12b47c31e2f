// See training.h.
#include "models/runs/training.h"

#include <algorithm>
#include <cstdlib>

#include "models/io/words.h"
#include "models/runs/scene_file.h"
#include "models/runs/version.h"
#include "runtime/device.h"
#include "runtime/host_memory.h"

namespace cloam {
namespace {

uint64_t training_bytes(const Captures& captures, int downscale) {
  uint64_t sum = 0;
  for (const Capture& capture : captures) sum += image_bytes(capture.scene, Split::train, downscale);
  return sum;
}

std::string state_of(const TrainResult& result) {
  if (result.end > 0 && result.step >= result.end) return "finished";
  if (result.interrupted) return "interrupted";
  return result.out_of_time ? "out of time" : "stopped";
}

void write_ended(TrainJob& job, const std::string& state) {
  job.record.state = state;
  job.record.ended = time_stamp();
  write_record(job.folder, job.record);
}

}  // namespace

uint64_t default_host_budget() { return host_free_bytes() / 100 * (device().is_cpu ? 15 : 50); }

TrainingInput read_input(TrainJob& job, const TrainRequest& request, uint64_t host_bytes, const CapturesTold& told) {
  TrainingInput input;
  if (!job.source) {
    const auto* learns = as<LearnsFromCaptures>(*job.method);
    const ImageMemory memory = {std::make_shared<HostStore>(host_bytes),
                                learns->images_on_device() ? memory_budget() : 0, learns->uses_depths()};
    input.captures = read_captures(job.data, job.record.reading, memory, told);
  }
  for (const Capture& capture : input.captures)
    job.default_steps += job.epochs * static_cast<int64_t>(capture.train.size());
  input.now = data_now(job, input.captures);
  check_data_unchanged(job, input.now);
  note_recordings(job, input.captures);
  job.method->build(job.source ? job.source->scenes : scenes_of(input.captures), job.record.seed);
  if (!request.resume) add_warnings(input.captures, job.record.method, *job.method);
  if (job.source) as<LearnsFromRun>(*job.method)->load(source_of(*job.source));
  adopt_networks(job, request);
  adopt_prior(job, request);
  return input;
}

PhotoSizes sizes_of(const Captures& captures) {
  PhotoSizes photos;
  for (const Capture& capture : captures) {
    photos.bytes += capture.train.bytes();
    for (const FramePixels& frame : capture.train.listed().frames)
      photos.largest =
          std::max(photos.largest, static_cast<uint64_t>(frame.width) * static_cast<uint64_t>(frame.height));
  }
  return photos;
}

MemoryPlan plan_memory(TrainJob& job, const PhotoSizes& photos, uint64_t host_bytes) {
  const MemoryPlan plan = job.method->memory(photos);
  job.record.memory = {plan.total(), memory_budget(), std::min(photos.bytes, host_bytes), host_bytes};
  return plan;
}

void check_memory(const MemoryPlan& plan, const TrainJob& job, const Captures& captures) {
  if (plan.total() <= memory_budget()) return;
  const uint64_t model = plan.total() - plan.images;
  std::string fix = text("fix: the model alone needs ", words_for_bytes(model), "; ", plan.smaller);
  for (int factor = job.record.reading.downscale + 1; factor <= 64 && model < memory_budget(); ++factor) {
    const uint64_t images = training_bytes(captures, factor);
    if (model + images > memory_budget()) continue;
    fix = text("fix: --downscale ", factor, " fits (", words_for_bytes(model + images), ")");
    break;
  }
  throw Error(Fault::memory, text("training needs ", words_for_bytes(plan.total()), ", the budget is ",
                                  words_for_bytes(memory_budget()), "\n  ", fix, "\n  or: --max-memory ",
                                  (plan.total() >> 20) + 1, "M, if the machine has that much"));
}

Scenes give_data(TrainJob& job, Captures captures, const std::function<void(std::size_t, std::size_t)>& told) {
  Scenes scenes;
  std::vector<TrainingData> data;
  for (Capture& capture : captures) {
    scenes.push_back(std::move(capture.scene));
    data.push_back({std::move(capture.resting), std::move(capture.train)});
  }
  if (auto* learns = as<LearnsFromCaptures>(*job.method)) {
    learns->loaded = told;
    learns->load_data(std::move(data));
    learns->loaded = [](std::size_t, std::size_t) {};
  }
  return scenes;
}

std::optional<LoadedCheckpoint> checkpoint_to_go_on(const TrainJob& job,
                                                    const std::function<void(const std::string&)>& warn) {
  if (!has_checkpoints(RunPaths{job.folder}.checkpoints())) {
    warn("the run has no checkpoint yet; training starts at the first step");
    return std::nullopt;
  }
  LoadedCheckpoint checkpoint = load_latest_checkpoint(RunPaths{job.folder}.checkpoints());
  check_belongs(checkpoint, job.record);
  if (!checkpoint.warning.empty()) warn(checkpoint.warning);
  return checkpoint;
}

void take_progress(TrainJob& job, const std::optional<LoadedCheckpoint>& checkpoint, const TrainRequest& request) {
  job.record.step = checkpoint ? checkpoint->step : 0;
  if (!checkpoint) return;
  const auto horizon = checkpoint->file.metadata.find("horizon");
  if (horizon != checkpoint->file.metadata.end())
    job.record.horizon = std::strtoll(horizon->second.c_str(), nullptr, 10);
  // The horizon that a budget chose stands; only a new budget limits what is left of it.
  if (job.record.horizon > 0 && !request.time_budget) job.record.time_budget_seconds.reset();
}

void begin_record(TrainJob& job, const std::vector<DataNow>& data, bool overwrite, const std::string& command_line) {
  if (overwrite && is_run(job.folder)) clear_run(job.folder);
  RunRecord& r = job.record;
  r.state = "running";
  r.version = kVersion;
  r.command_line = command_line;
  r.device = device().name + " (" + device().platform + ")";
  r.driver = device().driver;
  r.started = time_stamp();
  r.ended = "";
  note_places(job, data);
  write_record(job.folder, r);
}

void write_settings(const TrainJob& job, const Scenes& scenes) {
  const RunPaths paths{job.folder};
  if (std::filesystem::exists(paths.scene())) return;
  const RunRecord& r = job.record;
  write_config(job.folder, job.config,
               text("Settings of ", r.method, ", preset ", r.preset, "; the run again: cloam train ", r.method,
                    " DATA --preset ", r.preset, " --seed ", r.seed,
                    precision_of(r) == "mixed" ? " --precision mixed" : "", " --config FILE"));
  write_scenes(paths.scene(), scenes);
}

TrainOptions options_of(const TrainJob& job, const TrainRequest& request) {
  TrainOptions options;
  options.steps = job.record.steps;
  options.time_budget_seconds = job.record.time_budget_seconds;
  options.stop_after = request.stop_after;
  options.save_every = job.record.save_every;
  options.default_steps = job.default_steps;
  options.seed = job.record.seed;
  options.shares = job.record.shares;
  return options;
}

void end_record(TrainJob& job, const TrainResult& result) {
  if (result.step > 0) job.record.step = result.step;
  if (result.horizon > 0) job.record.horizon = result.horizon;
  write_ended(job, state_of(result));
}

void end_failed_record(TrainJob& job) { write_ended(job, "failed"); }

std::string way_on(const TrainJob& job, Fault fault, int64_t saved) {
  if (fault == Fault::diverged)  // the trainer says the rest
    return precision_of(job.record) == "mixed"
               ? "\n  or: numbers of 16 bits end at 65504; train anew with --precision full"
               : "";
  const std::string resume = "cloam train --resume " + quoted(job.folder.string());
  if (saved == 0) return text("\n  no checkpoint was saved yet; ", resume, " begins again with the first step");
  return text("\n  the checkpoint of step ", saved, " is whole; ", resume, " continues from it");
}

}  // namespace cloam
