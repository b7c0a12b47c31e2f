// See table_plan.h.
#include "models/eval/table_plan.h"

#include <algorithm>

#include "models/methods/registry.h"
#include "models/street/street.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Words = std::vector<std::string>;

/// Logs that the small table makes. Half of those that train lie under a sun, a quarter of these at night; the measured
/// ones are by day, as the paper's are. Generated actors are held against photographs of logs that nothing else sees.
enum class MadeFor { training, measuring, photographs };
struct MadeLogs {
  const char* folder;
  int count, seed;
  const char *clouds, *night, *cameras;
  MadeFor purpose;
  double seconds;  // of one log
};
constexpr int kMadeFrames = 40;
constexpr char kAllCameras[] = "front,front_left,front_right,left,right,back", kTwoCameras[] = "front,front_left";
constexpr MadeLogs kMadeLogs[] = {{"sun", 8, 1, "0", "0.25", kAllCameras, MadeFor::training, 15},
                                  {"clouds", 8, 2, "1", "0", kAllCameras, MadeFor::training, 15},
                                  {"measured-sun", 1, 3, "0", "0", kTwoCameras, MadeFor::measuring, 30},
                                  {"measured-clouds", 1, 4, "1", "0", kTwoCameras, MadeFor::measuring, 30},
                                  {"photographs-sun", 3, 5, "0", "0.34", kTwoCameras, MadeFor::photographs, 30},
                                  {"photographs-clouds", 3, 6, "1", "0", kTwoCameras, MadeFor::photographs, 30}};
constexpr std::size_t kLeastPhotographed = 3;  // logs: classes are told by what was learned from others
constexpr char kCrops[] = "crops";
/// For pictures of 160x90: more and smaller patches, and planes that they can fill.
const Words kMadeSettings = {"batch.patches=8", "batch.patch_side=24", "background.side=256"};

/// Steps where none are said; 0: what the preset says.
struct UsualSteps {
  const char* of;
  int64_t paper, small;
};
constexpr UsualSteps kUsualSteps[] = {{"train", 0, 2000}, {"fit", 0, 300}, {"assets", 0, 2000}, {"methods", 0, 1500}};

/// Seconds on two cores, before any were timed here: of a step or picture, with what a command takes to begin.
struct Pace {
  double begin, paper, small;
};
constexpr Pace kTrainPace = {10, 85, 0.3}, kAssetsPace = {10, 8, 0.06}, kPicturePace = {10, 25, 0.2},
               kGenerationPace = {20, 3600, 800}, kCropPace = {5, 0.5, 0.1}, kOtherStepPace = {10, 1, 0.1},
               kOtherPicturePace = {10, 10, 0.15};

double seconds_of(const Pace& pace, bool small, int64_t count) {
  return pace.begin + static_cast<double>(count) * (small ? pace.small : pace.paper);
}

std::string seed_word(int64_t seed) { return std::to_string(seed); }

class Planner {
 public:
  explicit Planner(const TableRequest& request) : plan_{request, {}}, request_(plan_.request) {}

  TablePlan plan() {
    if (request_.logs.train.empty()) make_logs();
    add_crops();
    for (const int64_t seed : request_.seeds)
      for (const TableRow& row : request_.rows) add_row(row, seed);
    if (std::none_of(plan_.nodes.begin(), plan_.nodes.end(),
                     [](const TableNode& node) { return node.work == TableWork::measure; }))
      throw Error(Fault::usage, "none of the rows has a figure of these protocols; choose others with --protocols");
    return std::move(plan_);
  }

 private:
  bool wants(const std::string& protocol) const {
    return std::find(request_.protocols.begin(), request_.protocols.end(), protocol) != request_.protocols.end();
  }

  int64_t steps_for(const std::string& of) const {
    if (const auto given = request_.steps.find(of); given != request_.steps.end()) return given->second;
    const auto* row = std::find_if(std::begin(kUsualSteps), std::end(kUsualSteps),
                                   [&](const UsualSteps& steps) { return of == steps.of; });
    return request_.small ? row->small : row->paper;
  }

  /// What a training of so many images takes when its preset decides.
  static int64_t steps_of(const Preset& preset, int64_t images) { return preset.steps + preset.epochs * images; }

  std::string preset_of(const TableRow& row) const {
    const std::vector<std::string> known = presets_of(row.method);
    const std::string small = row.method + "-small";
    const bool has_small = std::find(known.begin(), known.end(), small) != known.end();
    return (request_.small && has_small ? small : row.method) + row.preset_ending;
  }

  void make_logs() {
    made_ = true;
    const bool measures_others = !request_.logs.measured.empty();
    const bool learns_first = std::any_of(request_.rows.begin(), request_.rows.end(), learns_networks);
    for (const MadeLogs& made : kMadeLogs) {
      if (made.purpose == MadeFor::measuring ? measures_others : !learns_first) continue;
      TableNode node{"logs/" + std::string(made.folder), TableWork::logs, {}, {}, made.count};
      node.words = {"synth",
                    "-o",
                    "@/" + node.id,
                    "--logs",
                    std::to_string(made.count),
                    "--frames",
                    std::to_string(kMadeFrames),
                    "--size",
                    "160x90",
                    "--seed",
                    std::to_string(made.seed),
                    "--cameras",
                    made.cameras,
                    "--clouds",
                    made.clouds,
                    "--night",
                    made.night,
                    "--overwrite"};
      if (made.purpose == MadeFor::training) node.words.push_back("--no-truth");
      node.seconds = made.seconds * made.count;
      for (int log = 1; log <= made.count; ++log) {
        const int64_t cameras = 1 + std::count(made.cameras, made.cameras + std::string(made.cameras).size(), ',');
        const TableLog one{"@/" + node.id + "/00" + std::to_string(log), made.folder, cameras * kMadeFrames,
                           kMadeFrames};
        logs_for(made.purpose).push_back(one);
      }
      plan_.nodes.push_back(node);
    }
  }

  std::vector<TableLog>& logs_for(MadeFor purpose) {
    if (purpose == MadeFor::training) return request_.logs.train;
    return purpose == MadeFor::measuring ? request_.logs.measured : request_.logs.photographs;
  }

  /// The photographs of all rows' generated actors.
  void add_crops() {
    const std::vector<TableLog>& logs = request_.logs.photographs;
    const bool generates =
        std::any_of(request_.rows.begin(), request_.rows.end(), [](const TableRow& row) { return row.generates; });
    if (!wants(kGeneration) || !generates || logs.size() < kLeastPhotographed) return;
    TableNode node{kCrops, TableWork::crops, {"crops"}, needs_of(logs)};
    for (const TableLog& log : logs) {
      node.words.push_back(log.path);
      node.steps += log.images;
    }
    node.words.insert(node.words.end(), {"-o", text("@/", kCrops)});
    node.seconds = seconds_of(kCropPace, request_.small, node.steps);
    plan_.nodes.push_back(node);
    cropped_ = true;
  }

  /// The ids of the logs that are made for training, or of the folder of that log.
  Words needs_of(const std::vector<TableLog>& logs) const {
    Words needs;
    for (const TableLog& log : logs) {
      if (!log.path.starts_with("@/")) continue;
      const std::string id = log.path.substr(2, log.path.rfind('/') - 2);
      if (std::find(needs.begin(), needs.end(), id) == needs.end()) needs.push_back(id);
    }
    return needs;
  }

  void add_row(const TableRow& row, int64_t seed) {
    const std::string stage1 = "train/" + row.key + "/" + seed_word(seed),
                      networks = learns_networks(row) ? "@/" + stage1 : row.networks;
    if (learns_networks(row)) add_stage1(row, seed, stage1);
    for (const TableLog& log : request_.logs.measured) {
      if (wants("sparse")) add_fit(row, seed, log, "sparse", networks);
      if (wants("novel") || wants_turned(row)) add_fit(row, seed, log, "novel", networks);
    }
    if (row.generates && wants(kGeneration)) add_generation(row, seed, stage1);
  }

  static bool shares(const TableRow& row) { return has<SharesNetworks>(row.method); }

  /// What knows no actors cannot turn them.
  bool wants_turned(const TableRow& row) const { return wants("rotate360") && has<Street>(row.method); }

  void add_stage1(const TableRow& row, int64_t seed, const std::string& id) {
    TableNode node{id, TableWork::train, {"train", row.method}, needs_of(request_.logs.train)};
    int64_t images = 0;
    for (const TableLog& log : request_.logs.train) {
      node.words.push_back(log.path);
      images += log.images;
    }
    const std::string preset = preset_of(row);
    end_words(node, seed, steps_for("train"), steps_of(find_preset(preset), images), {"--preset", preset});
    for (const Words& settings : {made_ ? kMadeSettings : Words(), request_.settings, perceptual(), row.settings})
      for (const std::string& setting : settings) node.words.insert(node.words.end(), {"--set", setting});
    node.seconds = seconds_of(kTrainPace, request_.small, node.steps);
    plan_.nodes.push_back(node);
  }

  Words perceptual() const {
    return request_.perceptual.empty() ? Words() : Words{"perceptual.weights=" + request_.perceptual};
  }

  void end_words(TableNode& node, int64_t seed, int64_t steps, int64_t steps_of_preset, const Words& more) {
    node.steps = steps > 0 ? steps : steps_of_preset;
    node.words.insert(node.words.end(), {"-o", "@/" + node.id});
    node.words.insert(node.words.end(), more.begin(), more.end());
    node.words.insert(node.words.end(), {"--seed", seed_word(seed)});
    if (steps > 0) node.words.insert(node.words.end(), {"--steps", std::to_string(steps)});
  }

  /// networks: what `train --networks` takes; empty: the method learns the log from nothing.
  void add_fit(const TableRow& row, int64_t seed, const TableLog& log, const std::string& protocol,
               const std::string& networks) {
    const std::string place = row.key + "/" + seed_word(seed) + "/" + log.name + "/";
    TableNode node{"fit/" + place + protocol, TableWork::fit, {"train", row.method, log.path}, needs_of({log})};
    Words more = {"--protocol", protocol};
    if (networks.starts_with("@/")) node.needs.push_back(networks.substr(2));
    if (!networks.empty()) more.insert(more.end(), {"--networks", networks});
    const Preset& preset = find_preset(preset_of(row));
    if (networks.empty() && preset.name != row.method) more.insert(more.end(), {"--preset", preset.name});
    const int64_t images = protocol == "sparse" ? sparse_images(log.front_images) : log.front_images;
    end_words(node, seed, steps_for(networks.empty() ? "methods" : "fit"), steps_of(preset, images), more);
    node.seconds = seconds_of(networks.empty() ? kOtherStepPace : kTrainPace, request_.small, node.steps);
    plan_.nodes.push_back(node);
    if (wants(protocol)) {
      const int64_t pictures = protocol == "sparse" ? log.front_images - images : log.front_images;
      add_measurement(row, seed, log, protocol, node.id, pictures);
    }
    if (protocol == "novel" && wants_turned(row))
      add_measurement(row, seed, log, "rotate360", node.id, 8 * log.front_images);
  }

  void add_measurement(const TableRow& row, int64_t seed, const TableLog& log, const std::string& protocol,
                       const std::string& run, int64_t pictures) {
    TableNode node{"measure/" + row.key + "/" + seed_word(seed) + "/" + log.name + "/" + protocol, TableWork::measure};
    node.words = {"eval",       "@/" + run,        "--protocol", protocol,
                  "--features", request_.features, "--images",   "@/" + node.id + "/images"};
    if (!request_.lpips.empty()) node.words.insert(node.words.end(), {"--lpips", request_.lpips});
    node.needs = {run};
    node.steps = pictures;
    node.seconds = seconds_of(shares(row) ? kPicturePace : kOtherPicturePace, request_.small, pictures);
    node.row = row.key, node.log = log.name, node.protocol = protocol, node.seed = seed;
    plan_.nodes.push_back(node);
  }

  /// Stage 2 of a row, and what its samples look like.
  void add_generation(const TableRow& row, int64_t seed, const std::string& stage1) {
    const std::string place = row.key + "/" + seed_word(seed),
                      preset = request_.small ? "diffusion-small" : "diffusion";
    TableNode assets{"assets/" + place, TableWork::assets, {"train", "diffusion", "@/" + stage1}, {stage1}};
    end_words(assets, seed, steps_for("assets"), find_preset(preset).steps, {"--preset", preset});
    assets.seconds = seconds_of(kAssetsPace, request_.small, assets.steps);
    plan_.nodes.push_back(assets);
    TableNode node{"measure/" + place + "/" + kGeneration, TableWork::measure};
    node.words = {"eval", "@/" + assets.id, "--features", request_.features};
    node.needs = {assets.id, stage1};
    if (cropped_) {
      node.words.insert(node.words.end(), {"--photos", text("@/", kCrops)});
      node.needs.push_back(kCrops);
    }
    node.steps = 1;
    node.seconds = seconds_of(kGenerationPace, request_.small, 1);
    node.row = row.key, node.protocol = kGeneration, node.seed = seed;
    plan_.nodes.push_back(node);
  }

  TablePlan plan_;
  TableRequest& request_;
  bool made_ = false, cropped_ = false;
};

}  // namespace

bool take_turns(const TableNode& one, const TableNode& other) {
  return one.work == TableWork::measure && other.work == TableWork::measure && one.words.at(1) == other.words.at(1);
}

const std::vector<std::string>& table_steps() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const UsualSteps& steps : kUsualSteps) all.emplace_back(steps.of);
    return all;
  }();
  return names;
}

TablePlan table_plan(const TableRequest& request) { return Planner(request).plan(); }

}  // namespace cloam
