// See train_job.h.
#include "cli/train_job.h"

#include <algorithm>

#include "cli/settings.h"
#include "models/methods/registry.h"
#include "models/train/restore_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

bool holds_files(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().filename() != ".lock") return true;
  }
  return false;
}

std::string name_of_data(const fs::path& data) {
  std::error_code error;
  const std::string name = fs::weakly_canonical(data, error).filename().string();
  return name.empty() ? "data" : name;
}

std::string single_data(const TrainRequest& request) {
  if (request.data.size() == 1) return request.data.front();
  const std::string given = request.method;
  std::error_code error;
  if (request.data.empty() && fs::is_directory(given, error)) {
    throw Error(Fault::usage, text("the method is missing: cloam train nerf ", quoted(given)));
  }
  throw Error(Fault::usage, text("train ", given, " takes one data folder, got ", request.data.size()));
}

int64_t seed_of(const TrainRequest& request) { return request.seed.value_or(42); }

void apply_settings(const TrainRequest& request, const Preset& preset, Config& config) {
  for (const auto& [key, value] : preset.settings) config.set(key, value, text("preset ", preset.name));
  if (!request.config_file.empty()) {
    for (const auto& [key, value] : read_settings(request.config_file)) {
      config.set(key, value, "file " + fs::path(request.config_file).filename().string());
    }
  }
  for (const std::string& setting : request.settings) {
    const auto [key, value] = split_setting(setting);
    config.set(key, value, "--set");
  }
}

std::optional<double> budget_of(const TrainRequest& request) {
  if (request.time_budget.empty()) return std::nullopt;
  return parse_duration(request.time_budget);
}

void fill_record(const TrainRequest& request, TrainJob& job) {
  RunRecord& r = job.record;
  r.seed = static_cast<uint64_t>(seed_of(request));
  r.steps = request.steps;
  r.time_budget_seconds = budget_of(request);
  r.save_every = request.save_every.value_or(0);
  r.data.given = request.data.front();
  r.data.downscale = request.downscale.value_or(1);
  r.data.holdout = request.holdout.value_or(0);
  r.data.skip_bad = request.skip_bad;
  for (const ConfigEntry& entry : job.config.entries()) r.settings[entry.key] = to_string(entry.value);
}

template <class Value>
void same(const char* option, const std::optional<Value>& given, const Value& stored) {
  if (!given || *given == stored) return;
  throw Error(Fault::usage, text(option, " ", *given, " contradicts the run, which has ", stored,
                                 "; leave it out to go on, or start another run"));
}

std::optional<std::string> if_given(const std::string& value) {
  return value.empty() ? std::nullopt : std::optional(value);
}

void check_same(const TrainRequest& request, const RunRecord& record) {
  same("method", if_given(request.method), record.method);
  same("--preset", if_given(request.preset), record.preset);
  same("--seed", request.seed, static_cast<int64_t>(record.seed));
  same("--downscale", request.downscale, record.data.downscale);
  same("--holdout", request.holdout, record.data.holdout);
  if (request.steps && record.horizon > 0) same("--steps", request.steps, record.horizon);
  auto wanted = request.config_file.empty() ? decltype(read_settings("")){} : read_settings(request.config_file);
  for (const std::string& setting : request.settings) wanted.push_back(split_setting(setting));
  Config config;
  const auto method = configured_method(record, config);
  for (const auto& [key, value] : wanted) {
    config.set(key, value, "--set");
    for (const ConfigEntry& entry : config.entries()) {
      if (entry.key != key) continue;
      same(("--set " + key).c_str(), std::optional(to_string(entry.value)), record.settings.at(key));
    }
  }
}

MemoryPlan memory_plan(const TrainJob& job, const Capture& capture) {
  MemoryPlan plan = job.method->memory();
  if (plan.images == 0) plan.images = image_bytes(capture.scene, Split::train, job.record.data.downscale);
  return plan;
}

void check_memory(const MemoryPlan& plan, const TrainJob& job, const Capture& capture) {
  if (plan.total() <= memory_budget()) return;
  const uint64_t model = plan.total() - plan.images;
  std::string fix =
      text("fix: ", words_for_bytes(model), " are the model's: fewer of its --set batch.* or field.* fit");
  for (int factor = job.record.data.downscale + 1; factor <= 64 && model < memory_budget(); ++factor) {
    const uint64_t images = image_bytes(capture.scene, Split::train, factor);
    if (model + images > memory_budget()) continue;
    fix = text("fix: --downscale ", factor, " fits (", words_for_bytes(model + images), ")");
    break;
  }
  throw Error(Fault::memory,
              text("the plan needs ", words_for_bytes(plan.total()), " of a budget of ",
                   words_for_bytes(memory_budget()), "\n  ", fix, "\n  or: --max-memory, if the machine has more"));
}

std::string schedule_text(const TrainJob& job) {
  const RunRecord& r = job.record;
  if (r.horizon > 0) return text(r.horizon, " steps");
  if (r.steps) return text(*r.steps, " steps");
  if (r.time_budget_seconds) return "as many steps as " + words_for_seconds(*r.time_budget_seconds) + " allow";
  return text(job.default_steps, " steps");
}

Event plan_event(const TrainJob& job, const Capture& capture, const MemoryPlan& plan) {
  const Camera& camera = capture.train.cameras.front();
  return {{"method", job.record.method},
          {"preset", job.record.preset},
          {"data", job.data.string()},
          {"images_train", capture.train.frames.size()},
          {"images_test", capture.test.frames.size()},
          {"width", camera.width},
          {"height", camera.height},
          {"downscale", job.record.data.downscale},
          {"memory_bytes", plan.total()},
          {"memory_budget_bytes", memory_budget()},
          {"device", device().name},
          {"device_id", device().id},
          {"warnings", capture.warnings}};
}

}  // namespace

/// Never in silence over another run: hours may lie there.
void check_folder(const fs::path& folder, bool overwrite) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
    throw Error(Fault::usage, text(folder.string(), " is a file; name a folder with -o"));
  }
  if (!holds_files(folder)) return;
  if (!is_run(folder)) {
    throw Error(Fault::usage,
                text(folder.string(), " exists and holds files that are no run; name another folder with -o"));
  }
  if (overwrite) return;
  const RunRecord old = read_record(folder);
  const std::string go_on =
      old.state == "finished" ? "" : text("\n  go on:      cloam train --resume ", quoted(folder.string()));
  throw Error(Fault::usage, text(folder.string(), " already holds a run: ", old.method, ", ", old.state, " at step ",
                                 old.step, go_on, "\n  start anew: add --overwrite, or name another folder with -o"));
}

TrainJob new_job(const TrainRequest& request) {
  if (request.method.empty()) throw Error(Fault::usage, "want a method and a data folder: cloam train nerf DATA");
  TrainJob job;
  const std::string data = single_data(request);
  job.method = make_method(request.method);
  const Preset& preset = find_preset(request.preset.empty() ? request.method : request.preset);
  if (request.method != preset.method) {
    throw Error(Fault::usage,
                text("the preset ", preset.name, " is one of ", preset.method, ", not of ", request.method));
  }
  job.record.method = request.method;
  job.record.preset = preset.name;
  job.default_steps = preset.steps;
  job.method->configure(job.config);
  apply_settings(request, preset, job.config);
  job.data = data;
  job.folder =
      request.out.empty() ? fs::path("runs") / (name_of_data(data) + "-" + request.method) : fs::path(request.out);
  check_folder(job.folder, request.overwrite);
  fill_record(request, job);
  return job;
}

TrainJob resumed_job(const TrainRequest& request) {
  if (request.overwrite) throw Error(Fault::usage, "--resume and --overwrite contradict each other");
  TrainJob job;
  job.folder = request.out;
  job.record = read_record(job.folder);
  check_same(request, job.record);
  job.method = configured_method(job.record, job.config);
  job.default_steps = find_preset(job.record.preset).steps;
  job.finished = job.record.state == "finished";
  if (job.finished) return job;
  if (request.save_every) job.record.save_every = *request.save_every;
  if (request.steps) job.record.steps = request.steps;
  if (!request.time_budget.empty())
    job.record.time_budget_seconds = budget_of(request);
  else if (job.record.horizon > 0)
    job.record.time_budget_seconds.reset();  // the horizon it chose stands
  const std::string given = !request.new_data.empty() ? request.new_data
                            : request.data.empty()    ? ""
                                                      : request.data.front();
  job.data = given.empty() ? find_data(job.folder, job.record.data) : fs::path(given);
  if (!given.empty()) job.record.data.given = given;
  return job;
}

void tell_plan(const TrainJob& job, const Capture& capture, const Common& common, EventLog& log) {
  const MemoryPlan plan = memory_plan(job, capture);
  for (const std::string& warning : capture.warnings) warn(warning);
  const char* label = "plan   ";
  for (const std::string& line : describe(capture.scene, job.record.data)) {
    say(common, label + line);
    label = "       ";
  }
  say(common, text("model  ", job.record.method, ", preset ", job.record.preset, ", seed ", job.record.seed, ", ",
                   schedule_text(job)));
  say(common, "memory " + words_for_bytes(plan.total()) + " of " + words_for_bytes(memory_budget()) + " (images " +
                  words_for_bytes(plan.images) + ", parameters " + words_for_bytes(plan.parameters) + ", optimiser " +
                  words_for_bytes(plan.optimiser) + ", work " + words_for_bytes(plan.work) + ")");
  say(common,
      text("device ", device().name, " (", device().platform, "); the same again: ", device_spelling(device())));
  for (const ConfigEntry& entry : job.config.entries()) {
    if (common.verbose)
      say(common, text("       ", entry.key, " = ", to_string(entry.value), "  (", entry.origin, ") ", entry.help));
  }
  log.write("plan", plan_event(job, capture, plan));
  check_memory(plan, job, capture);
}

}  // namespace cloam
