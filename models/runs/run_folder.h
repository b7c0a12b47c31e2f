// What lies in a run folder, and the record of the run (run.json). The folder can be moved: it holds no absolute path.
#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/scene/split.h"
#include "models/train/config.h"

namespace cloam {

struct RunPaths {
  std::filesystem::path root;
  std::filesystem::path record() const { return root / "run.json"; }
  std::filesystem::path config() const { return root / "config.toml"; }
  std::filesystem::path scene() const { return root / "scene.json"; }
  std::filesystem::path generated() const { return root / "generated.safetensors"; }
  std::filesystem::path events() const { return root / "metrics.jsonl"; }
  std::filesystem::path checkpoints() const { return root / "ckpt"; }
  std::filesystem::path preview() const { return root / "preview"; }
  std::filesystem::path eval() const { return root / "eval"; }
  std::filesystem::path edit() const { return root / "edit"; }
  std::filesystem::path curves() const { return root / "curves.svg"; }
  std::filesystem::path report() const { return root / "report.html"; }
  std::filesystem::path turntable() const { return root / "turntable.gif"; }
  std::filesystem::path drive() const { return root / "drive.gif"; }
  std::filesystem::path assets() const { return root / "assets.png"; }
};

/// A folder that a run was made from.
struct RunData {
  std::string given;        // as typed
  std::string relative;     // from the run folder
  std::string fingerprint;  // of captures
};

/// "ignore", "transparent"; anything else is ignore.
MaskMeaning mask_meaning(const std::string& word);
std::string to_string(MaskMeaning meaning);

/// Which boxes are actors: those of vehicles and pedestrians (the classes of GenAssets' Table A1), or all.
enum class ActorChoice { road_users, all };
/// "road-users", "all"; anything else is all, as in records without it.
ActorChoice actor_choice(const std::string& word);
std::string to_string(ActorChoice choice);

/// How all captures of a run are read and split.
struct Reading {
  int downscale = 1;
  int holdout = 0;  // 0: the split of the source
  bool skip_bad = false;
  MaskMeaning masks = MaskMeaning::ignore;
  ActorChoice actors = ActorChoice::all;
  Protocol protocol = {};      // no name: none
  std::string image = {};      // "front_camera/05": that one alone; empty: all that the split gives
  bool allow_outside = false;  // --allow-outside: files that a manifest names outside of its folder are read, too
  std::vector<Recording> recordings = {};  // what was found, one a log; empty: all were read as stamped
};

/// What a training was planned to take, bytes. host: images and sweeps that it may hold there.
struct PlannedMemory {
  uint64_t device = 0, device_budget = 0, host = 0, host_budget = 0;
};

/// state: running | finished | interrupted | stopped (--stop-after) | out of time | failed.
struct RunRecord {
  std::string state = "running";
  std::string version, method, preset, command_line, device, driver, started, ended;
  uint64_t seed = 42;
  std::vector<RunData> data;  // one a scene
  Reading reading;
  std::optional<RunData> networks;     // the run whose networks it uses
  std::optional<RunData> prior;        // the run of diffusion that its codes are held to
  std::optional<RunData> edited_from;  // of an edited run: the run whose model it shows
  std::map<std::string, std::string> settings;
  std::optional<int64_t> steps;
  std::optional<double> time_budget_seconds;
  int64_t save_every = 0;
  int64_t shares = 1;                   // that each step's batch is split into
  int64_t step = 0, horizon = 0;        // where it stands, as far as known
  std::optional<PlannedMemory> memory;  // of the last training on it
};

/// Whether a run was ever started in the folder.
bool is_run(const std::filesystem::path& folder);

/// Fault::usage with the nearest name if there is no such folder; Fault::data if it holds no (sound) run.json.
RunRecord read_record(const std::filesystem::path& folder);
void write_record(const std::filesystem::path& folder, const RunRecord& record);

/// The settings with where each comes from, as a file that --config takes.
void write_config(const std::filesystem::path& folder, const Config& config, const std::string& head);

/// Where a capture of a run lies now: beside the folder as when it was trained, or as given. Fault::data if neither.
std::filesystem::path find_data(const std::filesystem::path& folder, const RunData& data);

/// `path` from the run folder, so that both can be moved together.
std::string relative_to_run(const std::filesystem::path& path, const std::filesystem::path& folder);

/// Number, names and sizes of the images, as a short text. Equal after copying the data elsewhere.
std::string fingerprint(const Scene& scene);

/// Fault::data unless the fingerprint of what lies at `place` is that of the data that a run was trained on (an old run
/// may not know it). otherwise: more of what to do.
void check_same_data(const std::filesystem::path& place, const RunData& data, const std::string& now,
                     const std::string& otherwise = "");

/// The event files for TensorBoard in a run folder, the newest last.
std::vector<std::filesystem::path> event_files(const std::filesystem::path& folder);
constexpr char kEventFile[] = "events.out.tfevents.";  // how their names begin

/// Removes what a run wrote (checkpoints, records, pictures), and nothing else.
void clear_run(const std::filesystem::path& folder);

/// The last line of a log that a kill may have cut is removed, so that further lines can follow.
void mend_log(const std::filesystem::path& path);

}  // namespace cloam
