// See train_plan.h.
#include "cli/train_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "models/runs/training.h"
#include "models/train/learns_from_run.h"
#include "runtime/verdict.h"

namespace cloam {
namespace {

/// Images that go to the device pass through the host.
std::string host_text(const PhotoSizes& photos, uint64_t budget, bool on_device) {
  const std::string images = text("images ", words_for_bytes(photos.bytes));
  if (on_device) return images + ", until they lie on the device";
  if (photos.bytes <= budget) return images + ", all of them held";
  return images + ", decoded ahead of use and held as far as there is room";
}

std::string schedule_text(const TrainJob& job) {
  const RunRecord& r = job.record;
  if (r.horizon > 0 && last_step(r) > r.horizon)
    return text(last_step(r), " steps, those after ", r.horizon, " at the schedules' final values");
  if (r.horizon > 0) return text(r.horizon, " steps");
  if (r.steps) return text(*r.steps, " steps");
  if (r.time_budget_seconds) return "as many steps as " + words_for_seconds(*r.time_budget_seconds) + " allow";
  if (job.epochs > 0) return text(job.default_steps, " steps (", job.epochs, " epochs)");
  return text(job.default_steps, " steps");
}

std::string words_for_count(int64_t count) {
  return count < 10000 ? text(count) : fmt::format("{:.2f} M", static_cast<double>(count) * 1e-6);
}

/// By the first two words of their names, all logs' together: "6.25 M: log.background 2.36 M, networks.decoder ...".
std::string parameters_text(const Params& parameters) {
  std::map<std::string, int64_t> counts;
  int64_t sum = 0;
  for (const auto& [name, p] : parameters) {
    const std::size_t first = std::min(name.find('.'), name.size()), second = name.find('.', first + 1);
    std::string group = name.substr(0, first);
    while (!group.empty() && std::isdigit(static_cast<unsigned char>(group.back()))) group.pop_back();
    counts[group + name.substr(first, second - first)] += p.numel();
    sum += p.numel();
  }
  std::string out = words_for_count(sum);
  for (const auto& [group, count] : counts)
    out += text(out.find(':') == std::string::npos ? ": " : ", ", group, " ", words_for_count(count));
  return out;
}

Event plan_event(const TrainJob& job, const Captures& captures, const PhotoSizes& photos) {
  const PlannedMemory& memory = *job.record.memory;
  const Camera& camera = captures.front().train.listed().cameras.front();
  std::size_t train = 0, test = 0;
  std::vector<std::string> data, warnings;
  for (std::size_t i = 0; i < captures.size(); ++i) {
    const Capture& capture = captures[i];
    data.push_back(job.data[i].string());
    train += capture.train.size();
    test += capture.test.size();
    warnings.insert(warnings.end(), capture.warnings.begin(), capture.warnings.end());
  }
  return {{"method", job.record.method},
          {"preset", job.record.preset},
          {"data", data},
          {"images_train", train},
          {"images_test", test},
          {"width", camera.width},
          {"height", camera.height},
          {"downscale", job.record.reading.downscale},
          {"memory_bytes", memory.device},
          {"memory_budget_bytes", memory.device_budget},
          {"host_bytes", memory.host},
          {"host_budget_bytes", memory.host_budget},
          {"image_bytes", photos.bytes},
          {"device", device().name},
          {"device_id", device().id},
          {"warnings", warnings}};
}

/// The plan of a method that learns from a run.
Event source_event(const TrainJob& job, const MemoryPlan& plan) {
  const auto& learns = *as<LearnsFromRun>(*job.method);
  return {{"method", job.record.method}, {"preset", job.record.preset},  {"data", {job.data.front().string()}},
          {"assets", learns.describe()}, {"memory_bytes", plan.total()}, {"memory_budget_bytes", memory_budget()},
          {"device", device().name},     {"device_id", device().id},     {"warnings", learns.warnings()}};
}

}  // namespace

void tell_plan(TrainJob& job, const Captures& captures, uint64_t host_budget, const Common& common, EventLog& log) {
  const PhotoSizes photos = sizes_of(captures);
  const MemoryPlan plan = plan_memory(job, photos, host_budget);
  std::string label = "plan   ";
  for (std::size_t i = 0; i < captures.size(); ++i) {
    const std::string name = captures.size() > 1 ? name_of_data(job.data[i]) + ": " : "";
    for (const std::string& warning : captures[i].warnings) warn(name + warning);
    for (const std::string& line : describe(captures[i].scene, job.record.reading)) {
      say(common, label + name + line);
      label = "       ";
    }
  }
  if (const auto* learns = as<LearnsFromRun>(*job.method)) {
    for (const std::string& warning : learns->warnings()) warn(warning);
    for (const std::string& line : learns->describe()) {
      say(common, label + line);
      label = "       ";
    }
  }
  say(common, text("model  ", job.record.method, ", preset ", job.record.preset, ", seed ", job.record.seed, ", ",
                   precision_of(job.record) == "mixed" ? "mixed precision, " : "", schedule_text(job)));
  say(common, "       parameters " + parameters_text(job.method->parameters()));
  say(common, "memory " + words_for_bytes(plan.total()) + " of " + words_for_bytes(memory_budget()) + " (images " +
                  words_for_bytes(plan.images) + ", parameters " + words_for_bytes(plan.parameters) + ", optimiser " +
                  words_for_bytes(plan.optimiser) + ", work " + words_for_bytes(plan.work) + ")");
  if (const auto* learns = as<LearnsFromCaptures>(*job.method))
    say(common, text("host   ", words_for_bytes(job.record.memory->host), " of ", words_for_bytes(host_budget), " (",
                     host_text(photos, host_budget, learns->images_on_device()), ")"));
  say(common, text("device ", device().name, " (", device().platform, "); select it with ", device_spelling(device())));
  const std::optional<Verdict> tested = verdict_of(device());
  say(common,
      text("       ", words_of(tested), tested ? "" : ": cloam selftest --quick checks that it computes correctly"));
  for (const ConfigEntry& entry : job.config.entries()) {
    if (common.verbose)
      say(common, text("       ", entry.key, " = ", to_string(entry.value), "  (", entry.origin, ") ", entry.help));
  }
  log.write("plan", captures.empty() ? source_event(job, plan) : plan_event(job, captures, photos));
  check_memory(plan, job, captures);
}

}  // namespace cloam
