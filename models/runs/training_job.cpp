// See training_job.h.
#include "models/runs/training_job.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/runs/settings.h"
#include "models/scene/split.h"
#include "models/train/learns_from_run.h"
#include "models/train/mixed_precision.h"
#include "models/train/old_names.h"
#include "models/train/shares_networks.h"
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

template <class Value>
void check_from(const char* option, const std::optional<Value>& given, Value least, Value most) {
  if (!given || (*given >= least && *given <= most)) return;
  const bool bounded = most < std::numeric_limits<Value>::max();
  throw Error(Fault::usage, text(option, " ", *given, ": want ",
                                 bounded ? text("from ", least, " to ", most) : text(least, " or more")));
}

/// What no training can be asked for, by whatever program: the command line's parser is not the only one who asks.
void check_numbers(const TrainRequest& request) {
  constexpr int64_t kAny = std::numeric_limits<int64_t>::max();
  check_from<int64_t>("--steps", request.steps, 1, kAny);
  check_from<int64_t>("--save-every", request.save_every, 1, kAny);
  check_from<int64_t>("--stop-after", std::optional(request.stop_after), 0, kAny);  // 0: none
  check_from<int64_t>("--seed", request.seed, 0, kAny);
  check_from<int64_t>("--gradient-accumulation", request.accumulation, 1, kMostShares);
  check_from<int>("--downscale", request.downscale, 1, 256);
  check_from<int>("--holdout", request.holdout, 2, 1 << 20);
  check_from<int>("--sparse-every", request.sparse_every, 2, 1 << 20);
  if (request.time_budget && !(std::isfinite(*request.time_budget) && *request.time_budget > 0))
    throw Error(Fault::usage, text("--time-budget ", *request.time_budget, ": want seconds, more than 0"));
}

void check_word(const char* option, const std::string& given, const std::vector<std::string>& words) {
  if (given.empty() || std::find(words.begin(), words.end(), given) != words.end()) return;
  throw Error(Fault::usage, text(option, " ", given, ": want one of ", joined(words), did_you_mean(given, words)));
}

void check_words(const TrainRequest& request) {
  check_word("--precision", request.precision, {"full", "mixed"});
  check_word("--masks", request.masks, {"ignore", "transparent"});
  check_word("--actors", request.actors, {"road-users", "all"});
  check_word("--protocol", request.protocol, protocol_names());
}

void check_data_given(const TrainRequest& request) {
  if (!request.data.empty()) return;
  const std::string given = request.method;
  std::error_code error;
  if (fs::is_directory(given, error)) {
    throw Error(Fault::usage, text("the method is missing: cloam train nerf ", quoted(given)));
  }
  throw Error(Fault::usage, text("DATA is missing: cloam train ", given, " DATA"));
}

/// "runs/fox-nerf", "runs/001+5-genassets" for six logs.
fs::path default_folder(const TrainRequest& request) {
  const std::size_t more = request.data.size() - 1;
  const std::string rest = more > 0 ? text("+", more) : "";
  return fs::path("runs") / (name_of_data(request.data.front()) + rest + "-" + request.method);
}

template <class Value>
void same(const char* option, const std::optional<Value>& given, const Value& stored) {
  if (!given || *given == stored) return;
  throw Error(Fault::usage, text(option, " ", *given, " differs from the run, which has ", stored,
                                 "; leave it out to resume, or start a new run"));
}

std::optional<std::string> if_given(const std::string& value) {
  return value.empty() ? std::nullopt : std::optional(value);
}

Protocol protocol_of(const TrainRequest& request) {
  if (request.protocol.empty() && request.sparse_every)
    throw Error(Fault::usage, "--sparse-every needs --protocol sparse");
  if (!request.protocol.empty() && request.holdout)
    throw Error(Fault::usage, "--protocol and --holdout both choose the training images; give only one");
  if (!request.image.empty() && (request.holdout || !request.protocol.empty()))
    throw Error(Fault::usage, "--image trains on that image alone; leave out --protocol and --holdout");
  if (!request.image.empty() && request.data.size() > 1)
    throw Error(Fault::usage, text("--image takes one log; ", request.data.size(), " are given"));
  return {request.protocol, request.sparse_every.value_or(0)};
}

/// What is no property of networks: how a prior is used, and whether logs have masks.
bool is_of_data(const std::string& setting) {
  return setting.starts_with("prior.") || setting == "weight.prior" || setting == "weight.silhouette";
}

/// Method, preset and settings of the run whose networks are taken are those of the new one, but for what is_of_data.
void take_networks(const TrainRequest& request, TrainJob& job) {
  const RunRecord other = read_record(request.networks);
  if (!request.method.empty() && request.method != other.method)
    throw Error(Fault::usage,
                text("--networks needs a ", request.method, " run; ", request.networks, " is ", other.method));
  same("--preset", if_given(request.preset), other.preset);
  job.record.preset = other.preset;
  job.record.reading.downscale = other.reading.downscale;
  job.record.networks = RunData{request.networks, "", ""};
  for (const auto& [key, value] : other.settings)
    if (!is_of_data(key)) job.config.restore(key, value, "run " + request.networks);
}

void take_prior(const TrainRequest& request, TrainJob& job) {
  if (request.prior.empty()) return;
  if (request.networks.empty())
    throw Error(Fault::usage, text("--prior ", request.prior,
                                   " also needs --networks RUN, the run that the prior learned from: other "
                                   "networks cannot decode its codes"));
  job.record.prior = RunData{request.prior, "", ""};
}

/// How the training stores what gradients need, whatever a file of settings or the run whose networks it has say.
void take_precision(const TrainRequest& request, TrainJob& job) {
  const bool mixed = request.precision == "mixed";
  if (mixed) require<MixedPrecision>(*job.method, request.method, "--precision mixed");
  if (has<MixedPrecision>(request.method)) job.config.set(kMixedPrecision, mixed ? "true" : "false", "--precision");
}

/// Into how many shares batches are split. A run goes on as it began, as long as its ranks can split the work.
void settle_shares(const TrainRequest& request, TrainJob& job) {
  int64_t& shares = job.record.shares;
  job.shares_before = request.resume ? shares : 1;
  if (!request.resume || request.accumulation || shares % request.ranks != 0)
    shares = request.ranks * request.accumulation.value_or(1);
  const int64_t most = job.method->most_shares();
  if (shares > most)
    throw Error(Fault::usage,
                text("a step's batch cannot be split into ", shares, " shares (", request.ranks,
                     request.ranks == 1 ? " rank" : " ranks", ", --gradient-accumulation ", shares / request.ranks,
                     "): its settings allow ", most, "\n  fix: fewer of them, or a larger batch: --set batch.*"));
}

/// Options that say how captures are read have no meaning for a run.
void check_source_options(const TrainRequest& request) {
  const std::pair<const char*, bool> options[] = {{"--downscale", request.downscale.has_value()},
                                                  {"--holdout", request.holdout.has_value()},
                                                  {"--skip-bad", request.skip_bad},
                                                  {"--allow-outside", request.allow_outside},
                                                  {"--protocol", !request.protocol.empty()},
                                                  {"--sparse-every", request.sparse_every.has_value()},
                                                  {"--image", !request.image.empty()},
                                                  {"--masks", !request.masks.empty()},
                                                  {"--actors", !request.actors.empty()},
                                                  {"--networks", !request.networks.empty()},
                                                  {"--prior", !request.prior.empty()}};
  for (const auto& [option, given] : options)
    if (given) throw Error(Fault::usage, text(option, " is for captures; ", request.method, " trains on a run"));
  if (request.data.size() > 1)
    throw Error(Fault::usage, text(request.method, " trains on one run; ", request.data.size(), " are given"));
}

/// The run to learn from, and the settings that follow from it.
void take_source(const TrainRequest& request, TrainJob& job) {
  const auto* learns = as<LearnsFromRun>(*job.method);
  if (!learns) return;
  check_source_options(request);
  const fs::path folder = request.data.front();
  StoredRun record_alone;
  record_alone.folder = folder;
  record_alone.record = read_record(folder);
  for (const auto& [key, value] : learns->settings_from(source_of(record_alone)))
    job.config.set(key, value, "run " + folder.string());
  job.source = read_run(folder);
}

void fill_record(const TrainRequest& request, TrainJob& job) {
  RunRecord& r = job.record;
  r.seed = static_cast<uint64_t>(request.seed.value_or(42));
  r.steps = request.steps;
  r.time_budget_seconds = request.time_budget;
  r.save_every = request.save_every.value_or(0);
  for (const std::string& data : request.data) r.data.push_back({data, "", ""});
  r.reading.downscale = request.downscale.value_or(r.reading.downscale);
  r.reading.holdout = request.holdout.value_or(0);
  r.reading.skip_bad = request.skip_bad;
  r.reading.allow_outside = request.allow_outside;
  r.reading.protocol = protocol_of(request);
  r.reading.image = request.image;
  r.reading.masks = mask_meaning(request.masks);
  r.reading.actors = actor_choice(request.actors.empty() ? to_string(ActorChoice::road_users) : request.actors);
  for (const ConfigEntry& entry : job.config.entries()) r.settings[entry.key] = to_string(entry.value);
}

/// More steps extend a finished run; one that is under way ends where it was to end.
void check_steps(const TrainRequest& request, const RunRecord& record) {
  if (!request.steps || record.horizon == 0) return;
  if (record.state != "finished") return same("--steps", request.steps, last_step(record));
  if (*request.steps < record.step)
    throw Error(Fault::usage, text("the run has already made ", record.step, " steps, more than --steps ",
                                   *request.steps, "; a larger number extends the run"));
}

void check_same(const TrainRequest& request, const RunRecord& record) {
  same("method", if_given(request.method), record.method);
  same("--preset", if_given(request.preset), record.preset);
  same("--seed", request.seed, static_cast<int64_t>(record.seed));
  same("--precision", if_given(request.precision), precision_of(record));
  same("--downscale", request.downscale, record.reading.downscale);
  same("--holdout", request.holdout, record.reading.holdout);
  same("--protocol", if_given(request.protocol), record.reading.protocol.name);
  same("--sparse-every", request.sparse_every, record.reading.protocol.sparse_every);
  same("--masks", if_given(request.masks), to_string(record.reading.masks));
  same("--actors", if_given(request.actors), to_string(record.reading.actors));
  same("--networks", if_given(request.networks), record.networks ? record.networks->given : "none");
  same("--image", if_given(request.image), record.reading.image.empty() ? "none" : record.reading.image);
  if (!request.prior.empty() && !record.prior) same("--prior", if_given(request.prior), std::string("none"));
  check_steps(request, record);
  Settings wanted = request.config_file.empty() ? Settings{} : read_settings(request.config_file);
  for (const std::string& setting : request.settings) wanted.push_back(split_setting(setting));
  Config config;
  const auto method = configured_method(record, config);
  for (const auto& [key, value] : wanted) {
    config.set(key, value, "--set");
    for (const ConfigEntry& entry : config.entries()) {
      if (entry.key != current_setting(key)) continue;
      const auto known = record.settings.find(entry.key);
      same(("--set " + key).c_str(), std::optional(to_string(entry.value)),
           known == record.settings.end() ? "" : known->second);
    }
  }
}

/// One folder a capture of the run: as given now, else where the record says.
void find_captures(const std::vector<std::string>& given, TrainJob& job) {
  std::vector<RunData>& data = job.record.data;
  if (!given.empty() && given.size() != data.size())
    throw Error(Fault::usage, text("the run has ", data.size(), " data folders, but ", given.size(),
                                   " are named; name one for each, in the run's order"));
  for (std::size_t i = 0; i < data.size(); ++i) {
    job.data.push_back(given.empty() ? find_data(job.folder, data[i]) : fs::path(given[i]));
    if (!given.empty()) data[i].given = given[i];
  }
}

}  // namespace

int64_t last_step(const RunRecord& record) { return std::max(record.horizon, record.steps.value_or(0)); }

std::string name_of_data(const fs::path& data) {
  std::error_code error;
  const std::string name = fs::weakly_canonical(data, error).filename().string();
  return name.empty() ? "data" : name;
}

/// Never in silence over another run: hours may lie there.
void check_folder(const fs::path& folder, bool overwrite) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
    throw Error(Fault::usage, text(folder.string(), " is a file; name a folder with -o"));
  }
  if (!holds_files(folder)) return;
  if (!is_run(folder)) {
    throw Error(Fault::usage, text(folder.string(), " holds files but no run; name another folder with -o"));
  }
  if (overwrite) return;
  const RunRecord old = read_record(folder);
  const std::string go_on =
      old.state == "finished" ? "" : text("\n  continue:   cloam train --resume ", quoted(folder.string()));
  throw Error(Fault::usage, text(folder.string(), " already holds a run: ", old.method, ", ", old.state, " at step ",
                                 old.step, go_on, "\n  start over: add --overwrite, or name another folder with -o"));
}

TrainJob new_job(const TrainRequest& request, const Listener& listener) {
  if (request.method.empty()) throw Error(Fault::usage, "METHOD and DATA are missing: cloam train nerf DATA");
  TrainJob job;
  check_data_given(request);
  check_numbers(request);
  check_words(request);
  job.method = make_method(request.method);
  job.record.preset = request.preset.empty() ? request.method : request.preset;
  job.method->configure(job.config);
  if (!request.networks.empty()) take_networks(request, job);
  const Preset& preset = find_preset(job.record.preset);
  if (request.method != preset.method) {
    throw Error(Fault::usage,
                text("preset ", preset.name, " belongs to ", preset.method, ", not to ", request.method,
                     "\n  fix: train ", preset.method, ", or choose one of ", joined(presets_of(request.method))));
  }
  job.record.method = request.method;
  job.default_steps = preset.steps;
  job.epochs = preset.epochs;
  if (request.networks.empty())
    for (const auto& [key, value] : preset.settings) job.config.set(key, value, text("preset ", preset.name));
  take_source(request, job);
  take_prior(request, job);
  apply_settings({request.config_file, request.settings}, job.config, listener);
  // Whatever a file of settings says, which may be another run's.
  if (has<SharesNetworks>(request.method))
    job.config.set(kNetworksFrozen, request.networks.empty() ? "false" : "true", "--networks");
  take_precision(request, job);
  job.data.assign(request.data.begin(), request.data.end());
  job.folder = request.out.empty() ? default_folder(request) : fs::path(request.out);
  check_folder(job.folder, request.overwrite);
  fill_record(request, job);
  settle_shares(request, job);
  return job;
}

TrainJob resumed_job(const TrainRequest& request) {
  if (request.overwrite)
    throw Error(Fault::usage, "--resume continues the run, --overwrite replaces it; give only one");
  check_numbers(request);
  check_words(request);
  TrainJob job;
  job.folder = request.out;
  job.record = read_record(job.folder);
  if (job.record.edited_from) {
    throw Error(Fault::usage,
                text(job.folder.string(), " is an edited run, whose images no longer match its scenes. Train ",
                     job.record.edited_from->given, " further and edit that"));
  }
  check_same(request, job.record);
  job.method = configured_method(job.record, job.config);
  job.default_steps = find_preset(job.record.preset).steps;
  job.epochs = find_preset(job.record.preset).epochs;
  job.finished = job.record.state == "finished" && request.steps.value_or(0) <= job.record.step;
  if (request.allow_outside) job.record.reading.allow_outside = true;
  const std::vector<std::string>& given = request.new_data.empty() ? request.data : request.new_data;
  if (!job.finished || !given.empty()) find_captures(given, job);
  if (as<LearnsFromRun>(*job.method) && !job.data.empty()) job.source = read_run(job.data.front());
  if (job.finished) return job;
  settle_shares(request, job);
  if (request.save_every) job.record.save_every = *request.save_every;
  if (request.steps) job.record.steps = request.steps;
  if (request.time_budget)
    job.record.time_budget_seconds = request.time_budget;
  else if (job.record.horizon > 0)
    job.record.time_budget_seconds.reset();  // the horizon it chose stands
  if (!request.prior.empty()) job.record.prior->given = request.prior;
  return job;
}

}  // namespace cloam
