// run.json and the other small files of a run folder. Field names are documented in docs/formats.md.
#include "models/runs/run_folder.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "models/data/read_scene.h"
#include "models/data/recording_file.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/share.h"
#include "models/io/words.h"
#include "models/runs/box_file.h"
#include "models/runs/settings.h"
#include "models/train/old_names.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kSchema = 2;
const std::pair<const char*, std::string RunRecord::*> kWords[] = {
    {"state", &RunRecord::state},   {"version", &RunRecord::version},           {"method", &RunRecord::method},
    {"preset", &RunRecord::preset}, {"command_line", &RunRecord::command_line}, {"device", &RunRecord::device},
    {"driver", &RunRecord::driver}, {"started", &RunRecord::started},           {"ended", &RunRecord::ended}};

int64_t whole(const Json& object, const std::string& key, const std::string& where) {
  const Json& value = member(object, key, where);
  if (!value.is_number_integer()) throw Error(Fault::data, text(where, ": \"", key, "\" is not a whole number"));
  return value.get<int64_t>();
}

uint64_t seed_of(const Json& object, const std::string& where) {
  const Json& value = member(object, "seed", where);
  if (!value.is_number_unsigned())
    throw Error(Fault::data, text(where, ": \"seed\" is not a whole number of 0 or more"));
  return value.get<uint64_t>();
}

Json to_json(const RunData& data) {
  return {{"given", data.given}, {"relative", data.relative}, {"fingerprint", data.fingerprint}};
}

RunData data_from(const Json& json, const std::string& where) {
  return {string(json, "given", where), string(json, "relative", where), string(json, "fingerprint", where)};
}

Json to_json(const Reading& reading) {
  Json json = {{"downscale", reading.downscale},
               {"holdout", reading.holdout},
               {"skip_bad", reading.skip_bad},
               {"protocol", reading.protocol.name},
               {"sparse_every", reading.protocol.sparse_every}};
  if (reading.masks != MaskMeaning::ignore) json["masks"] = to_string(reading.masks);
  if (reading.actors != ActorChoice::all) json["actors"] = to_string(reading.actors);
  if (!reading.image.empty()) json["image"] = reading.image;
  if (reading.allow_outside) json["allow_outside"] = true;
  for (const Recording& recording : reading.recordings) json["recordings"].push_back(to_json(recording));
  return json;
}

Reading reading_from(const Json& json, const std::string& where) {
  Reading reading;
  reading.downscale = static_cast<int>(std::clamp<int64_t>(whole(json, "downscale", where), 1, 1 << 16));
  reading.holdout = static_cast<int>(std::clamp<int64_t>(whole(json, "holdout", where), 0, 1 << 30));
  reading.skip_bad = flag(json, "skip_bad", false, where);
  reading.protocol.name = string(json, "protocol", where);
  reading.protocol.sparse_every = static_cast<int>(std::clamp<int64_t>(whole(json, "sparse_every", where), 0, 1 << 30));
  reading.masks = mask_meaning(optional_string(json, "masks", where).value_or(""));
  reading.actors = actor_choice(optional_string(json, "actors", where).value_or(""));
  reading.image = optional_string(json, "image", where).value_or("");
  reading.allow_outside = flag(json, "allow_outside", false, where);
  if (json.contains("recordings"))
    for (const Json& recording : array(json, "recordings", where))
      reading.recordings.push_back(recording_from(recording, where + ", recordings"));
  return reading;
}

Json options_to_json(const RunRecord& record) {
  Json options = {{"save_every", record.save_every}};
  if (record.shares > 1) options["shares"] = record.shares;
  if (record.steps) options["steps"] = *record.steps;
  if (record.time_budget_seconds) options["time_budget_seconds"] = *record.time_budget_seconds;
  return options;
}

void read_options(RunRecord& record, const Json& options, const std::string& where) {
  record.save_every = whole(options, "save_every", where);
  if (optional_number(options, "shares", where))
    record.shares = std::clamp<int64_t>(whole(options, "shares", where), 1, kMostShares);
  if (optional_number(options, "steps", where)) record.steps = whole(options, "steps", where);
  record.time_budget_seconds = optional_number(options, "time_budget_seconds", where);
}

Json to_json(const PlannedMemory& memory) {
  return {{"device_bytes", memory.device},
          {"device_budget_bytes", memory.device_budget},
          {"host_bytes", memory.host},
          {"host_budget_bytes", memory.host_budget}};
}

PlannedMemory memory_from(const Json& json, const std::string& where) {
  const auto bytes = [&](const char* key) { return static_cast<uint64_t>(whole(json, key, where)); };
  return {bytes("device_bytes"), bytes("device_budget_bytes"), bytes("host_bytes"), bytes("host_budget_bytes")};
}

/// Version 1 had one capture, and beside its place how it is read.
Json as_of_now(Json json, const std::string& where) {
  if (whole(json, "schema_version", where) != 1) return json;
  Json data = member(json, "data", where);
  json["reading"] = {{"downscale", member(data, "downscale", where)},
                     {"holdout", member(data, "holdout", where)},
                     {"skip_bad", member(data, "skip_bad", where)},
                     {"protocol", ""},
                     {"sparse_every", 0}};
  json["data"] = Json::array({data});
  json["schema_version"] = kSchema;
  return json;
}

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    names.push_back(entry->path().filename().string());
  }
  return names;
}

[[noreturn]] void no_folder(const fs::path& folder) {
  std::error_code error;
  if (fs::exists(folder, error))
    throw Error(Fault::usage, text(folder.string(), " is a file; name a run folder, which cloam train makes"));
  throw Error(Fault::usage, text("no such run folder: ", folder.string(), did_you_mean_path(folder)));
}

uint64_t mixed(uint64_t hash, const std::string& bytes) {  // FNV-1a
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return hash;
}

}  // namespace

MaskMeaning mask_meaning(const std::string& word) {
  return word == "transparent" ? MaskMeaning::transparent : MaskMeaning::ignore;
}

std::string to_string(MaskMeaning meaning) { return meaning == MaskMeaning::transparent ? "transparent" : "ignore"; }

ActorChoice actor_choice(const std::string& word) {
  return word == "road-users" ? ActorChoice::road_users : ActorChoice::all;
}

std::string to_string(ActorChoice choice) { return choice == ActorChoice::all ? "all" : "road-users"; }

bool is_run(const fs::path& folder) {
  std::error_code error;
  return fs::is_regular_file(RunPaths{folder}.record(), error);
}

RunRecord read_record(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) no_folder(folder);
  const fs::path path = RunPaths{folder}.record();
  if (!is_run(folder)) {
    throw Error(Fault::data, text(folder.string(), " is not a run folder: looked for run.json, found ",
                                  names_in(folder).size(), " other entries; train first, or name another folder"));
  }
  const std::string where = path.string();
  const Json json = as_of_now(parse_json_file(path), where);
  if (whole(json, "schema_version", where) != kSchema)
    throw Error(Fault::data, text(where, ": looked for schema_version ", kSchema, ", found ",
                                  json["schema_version"].dump(), ": it was written by another version of the program",
                                  "\n  fix: use the version that wrote it, or train again"));
  RunRecord record;
  for (const auto& [key, word] : kWords) record.*word = string(json, key, where);
  record.seed = seed_of(json, where);
  record.step = whole(json, "step", where);
  record.horizon = whole(json, "horizon", where);
  for (const Json& data : array(json, "data", where)) record.data.push_back(data_from(data, where + ", data"));
  if (record.data.empty()) throw Error(Fault::data, where + ": \"data\" is empty");
  record.reading = reading_from(member(json, "reading", where), where + ", reading");
  if (json.contains("networks")) record.networks = data_from(json["networks"], where + ", networks");
  if (json.contains("prior")) record.prior = data_from(json["prior"], where + ", prior");
  if (json.contains("edited_from")) record.edited_from = data_from(json["edited_from"], where + ", edited_from");
  read_options(record, member(json, "options", where), where + ", options");
  if (json.contains("memory")) record.memory = memory_from(json["memory"], where + ", memory");
  const Json& settings = member(json, "settings", where);
  if (!settings.is_object()) throw Error(Fault::data, where + ": \"settings\" is not an object");
  for (const auto& [key, value] : settings.items())
    record.settings[current_setting(key)] = string(settings, key, where + ", settings");
  return record;
}

void write_record(const fs::path& folder, const RunRecord& r) {
  nlohmann::ordered_json json = {{"schema_version", kSchema}};
  for (const auto& [key, word] : kWords) json[key] = r.*word;
  json["seed"] = r.seed;
  json["step"] = r.step;
  json["horizon"] = r.horizon;
  Json data = Json::array();
  for (const RunData& one : r.data) data.push_back(to_json(one));
  json["data"] = data;
  json["reading"] = to_json(r.reading);
  if (r.networks) json["networks"] = to_json(*r.networks);
  if (r.prior) json["prior"] = to_json(*r.prior);
  if (r.edited_from) json["edited_from"] = to_json(*r.edited_from);
  json["options"] = options_to_json(r);
  if (r.memory) json["memory"] = to_json(*r.memory);
  json["settings"] = r.settings;
  commit_text(RunPaths{folder}.record(), json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

void write_config(const fs::path& folder, const Config& config, const std::string& head) {
  commit_text(RunPaths{folder}.config(), config_text(config.entries(), head));
}

fs::path find_data(const fs::path& folder, const RunData& data) {
  std::error_code error;
  const fs::path beside = fs::weakly_canonical(folder, error) / data.relative;
  if (is_place_of_data(beside)) return beside.lexically_normal();
  if (is_place_of_data(data.given)) return data.given;
  throw Error(Fault::data, text("the data of the run ", folder.string(),
                                " is gone.\n  looked for: ", beside.lexically_normal().string(), "; ", data.given,
                                "\n  fix:        name its new place with --data; cloam train --resume ",
                                quoted(folder.string()), " --data PLACE records it"));
}

std::string relative_to_run(const fs::path& path, const fs::path& folder) {
  std::error_code error;
  return fs::relative(path, fs::weakly_canonical(folder, error), error).string();
}

std::string fingerprint(const Scene& scene) {
  std::vector<std::string> lines;
  for (const Frame& frame : scene.frames) {
    std::error_code error;
    const auto size = fs::file_size(scene.root / frame.image, error);
    lines.push_back(text(frame.image, '\n', error ? 0 : size, '\n'));
  }
  std::sort(lines.begin(), lines.end());
  uint64_t hash = 0xcbf29ce484222325;
  for (const std::string& line : lines) hash = mixed(hash, line);
  std::ostringstream out;
  out << scene.frames.size() << " images, " << std::hex << hash;
  return out.str();
}

void check_same_data(const fs::path& place, const RunData& data, const std::string& now, const std::string& otherwise) {
  if (data.fingerprint.empty() || data.fingerprint == now) return;
  throw Error(Fault::data, text(place.string(), " is not what the run was trained on (", data.fingerprint,
                                "; this has ", now, ").\n  fix: name the run's own data with --data", otherwise));
}

std::vector<fs::path> event_files(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    if (entry->path().filename().string().starts_with(kEventFile)) found.push_back(entry->path());
  std::sort(found.begin(), found.end());
  return found;
}

void clear_run(const fs::path& folder) {
  const RunPaths paths{folder};
  std::error_code error;
  std::vector<fs::path> written = event_files(folder), boxes = box_files(folder);
  written.insert(written.end(), boxes.begin(), boxes.end());
  written.insert(written.end(), {paths.checkpoints(), paths.preview(), paths.eval(), paths.edit(), paths.events(),
                                 paths.curves(), paths.report(), paths.turntable(), paths.drive(), paths.assets(),
                                 paths.config(), paths.generated(), paths.scene(), paths.record()});
  for (const fs::path& path : written) {
    fs::remove_all(path, error);
    if (error) throw Error(Fault::write, text(path.string(), ": cannot be removed: ", error.message()));
  }
}

void mend_log(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return;
  const std::string content((std::istreambuf_iterator<char>(file)), {});
  const std::size_t end = content.rfind('\n');
  const std::size_t whole_lines = end == std::string::npos ? 0 : end + 1;
  std::error_code error;
  if (whole_lines != content.size()) fs::resize_file(path, whole_lines, error);
}

}  // namespace cloam
