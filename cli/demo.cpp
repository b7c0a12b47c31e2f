// cloam demo: the whole way, from streets that it makes itself to new vehicles in them. No data, no network, no GPU
// needed.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/commands.h"
#include "cli/demo_page.h"
#include "cli/eval.h"
#include "cli/page.h"
#include "cli/shipped.h"
#include "cli/stop_signal.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/nn/feature_network.h"
#include "models/runs/actor_names.h"
#include "models/runs/scene_file.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;
using Words = std::vector<std::string>;

constexpr double kStreetShare = 0.7, kPriorShare = 0.3;  // of the time budget
constexpr std::size_t kClasses = 3, kSwapped = 6;
constexpr int kAllOfTraining = 1000;
constexpr char kNone[] = "none";  // networks to begin with
constexpr char kEach[] = "2";     // new vehicles of a class and time of day
constexpr char kDemoExamples[] =
    R"(Make synthetic streets, reconstruct them, learn what their vehicles are like, generate new ones and put
them into a street. The result is a page of pictures and metrics: demo/index.html.

Examples:
  cloam demo
  cloam demo -o showcase --time-budget 20m
  cloam demo --features pt_inception-2015-12-05-6726825d.pth      measures FID)";

struct DemoRequest {
  std::string out = "demo", time_budget = "9m", size = "160x90", features = "random", networks = kShipped;
  int logs = 4, frames = 12, assets = 48, steps = 0;
  std::vector<std::string> settings;
};

struct Swap {
  int log = 0;
  std::vector<std::string> actors;
  std::size_t pixels = 0;
};

/// Classes and times of day of the assets that `generate --codes training` showed.
std::map<std::pair<std::string, std::string>, int> kinds_in(const fs::path& folder) {
  std::map<std::pair<std::string, std::string>, int> kinds;
  const auto made = parse_json_file(folder / "generate.json");
  for (const auto& asset : made.at("assets"))
    kinds[{asset.at("class").get<std::string>(), asset.at("time").get<std::string>()}]++;
  return kinds;
}

/// "Construction-vehicle-night".
std::string folder_name(const std::string& asset_class, const std::string& time) {
  std::string name = asset_class + "-" + time;
  std::replace(name.begin(), name.end(), ' ', '-');
  return name;
}

/// The pixels of each actor of a log in all its pictures, by what `render --masks` wrote.
std::map<std::string, std::size_t> pixels_of(const fs::path& folder, const std::string& log) {
  const auto names = parse_json_file(folder / (log + "_actors.json"));
  std::map<std::string, std::size_t> pixels;
  for (const fs::path& file : files_in(folder, log + "_", "_actor.png"))
    for (const std::uint16_t actor : read_labels(file).values)
      if (actor > 0) pixels[names.at(std::to_string(actor)).get<std::string>()]++;
  return pixels;
}

double pictures(const DemoRequest& request) {
  const ImageSize size = parse_size(request.size);
  return request.logs * request.frames * static_cast<double>(size.width * size.height) / (4 * 12 * 160 * 90);
}

double assets(const DemoRequest& request) { return (request.assets / 48.0 + request.logs / 4.0) / 2; }

double one(const DemoRequest&) { return 1; }

/// How long the trainings took that ran so far.
double trained(const DemoRecord& made) {
  double sum = 0;
  for (const DemoCommand& command : made.commands)
    if (command.line.starts_with("cloam train")) sum += command.seconds;
  return sum;
}

/// For a training: its share of the budget in seconds, or the steps that were asked for.
Words with_schedule(Words words, const DemoRequest& request, double seconds) {
  if (request.steps > 0)
    words.insert(words.end(), {"--steps", std::to_string(request.steps)});
  else
    words.insert(words.end(), {"--time-budget", text(std::lround(std::max(1.0, seconds)), "s")});
  return words;
}

/// The log whose vehicles cover most of its pictures, and those of them that cover most.
Swap best_swap(const DemoFolders& folders) {
  const RunRecord record = read_record(folders.street());
  const Scenes scenes = read_scene_file(folders.street() / "scene.json");
  const auto kinds = kinds_in(folders.training());
  const std::vector<std::string> logs = log_names(record);
  Swap best;
  for (std::size_t log = 0; log < scenes.size(); ++log) {
    const auto pixels = pixels_of(folders.before(), logs[log]);
    std::vector<std::pair<std::size_t, std::string>> vehicles;
    for (const Actor& actor : scenes[log].actors) {
      const std::string kind = kAssetClasses[asset_class(actor.label)];
      const auto seen = pixels.find(actor.id);
      if (is_vehicle(asset_class(kind)) && !actor.boxes.empty() &&
          kinds.contains({kind, scenes[log].night ? "night" : "day"}))
        vehicles.emplace_back(seen == pixels.end() ? 0 : seen->second, actor.id);
    }
    std::sort(vehicles.rbegin(), vehicles.rend());
    vehicles.resize(std::min(vehicles.size(), kSwapped));
    Swap swap{static_cast<int>(log), {}, 0};
    for (const auto& [count, id] : vehicles) swap.actors.push_back(id), swap.pixels += count;
    if (best.actors.empty() || swap.pixels > best.pixels) best = swap;
  }
  if (!best.actors.empty()) return best;
  throw Error(Fault::data, "no vehicle in the streets is of a class that was learned\n  fix: a longer --time-budget");
}

/// A demo before this one, but nothing else.
void clear(const DemoFolders& f) {
  std::error_code error;
  if (!fs::exists(f.root, error) || fs::is_empty(f.root, error)) return;
  if (!fs::exists(f.record(), error))
    throw Error(Fault::usage,
                text(f.root.string(), " exists and is not a demo; name another folder with -o, or remove it"));
  for (const fs::path& path : {f.page(), f.first(), f.logs(), f.street(), f.prior(), f.training(), f.samples(),
                               f.gaussian(), f.random(), f.assets(), f.before(), f.edited(), f.after()}) {
    fs::remove_all(path, error);
    if (error) throw Error(Fault::write, text(path.string(), ": cannot be removed: ", error.message()));
  }
}

Report record_of(const DemoRecord& made, double seconds) {
  Report json = {{"schema_version", 1}, {"page", nullptr}, {"seconds", seconds}};
  if (fs::exists(made.folders.page())) json["page"] = made.folders.page().string();
  json["street"] = made.street;
  json["prior"] = made.prior;
  json["distance_of_samples"] = made.samples;
  json["distance_of_gaussian_codes"] = made.gaussian;
  json["distance_of_random_latents"] = made.random;
  json["swapped"] = {{"log", made.swapped_log}, {"actors", made.swapped}};
  json["commands"] = Report::array();
  for (const DemoCommand& command : made.commands)
    json["commands"].push_back({{"command", command.line}, {"seconds", command.seconds}});
  return json;
}

/// For signals between commands, which handle them themselves; every file is whole at any time.
extern "C" void leave(int signal) {
  constexpr char kTold[] = "\nstopped: the finished parts are in the demo's folder\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kTold, sizeof kTold - 1);
  _exit(128 + signal);
}

class Demo {
 public:
  Demo(const DemoRequest& request, const Common& common) : request_(request), common_(common) {
    made_.folders.root = request.out;
    budget_ = parse_duration(request.time_budget);
  }

  int run();

 private:
  struct Part {
    const char* what;
    double seconds;                      // with the default sizes on two cores of 2023, trainings aside
    double (*size)(const DemoRequest&);  // of what takes these seconds, 1 by default
    double share;                        // of the time budget
    int (Demo::*run)();
  };
  static const std::vector<Part> kParts;

  int show_shipped();
  int make_streets();
  int reconstruct();
  int learn_assets();
  int generate();
  int swap_vehicles();
  int write_page();

  /// Runs a command and notes it. Talkative ones are told to be quiet.
  int run_noted(const Words& words, bool talks = false);
  Report evaluated(const fs::path& run);
  Report distance(const fs::path& set);
  void note(const Words& words, double seconds_before);
  void tell(std::size_t part) const;
  std::string time_left(std::size_t part) const;
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count(); }
  /// With the options that all commands have.
  Words with_common(Words words, bool quiet) const;

  const DemoRequest request_;
  const Common common_;
  DemoRecord made_;
  double budget_ = 0;
  double expected_ = 0;  // of the parts so far, trainings aside
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
};

const std::vector<Demo::Part> Demo::kParts = {
    {"new vehicles of the prior that comes with the program", 20, one, 0, &Demo::show_shipped},
    {"making synthetic streets: driving logs with cameras, LiDAR and boxes", 10, pictures, 0, &Demo::make_streets},
    {"reconstructing them; a sixth of the images is held out for evaluation", 20, pictures, kStreetShare,
     &Demo::reconstruct},
    {"learning what their assets are like: diffusion on their latent codes", 5, one, kPriorShare, &Demo::learn_assets},
    {"generating assets, and baselines from Gaussian codes and random latents", 75, assets, 0, &Demo::generate},
    {"replacing vehicles in a street with generated ones", 30, pictures, 0, &Demo::swap_vehicles},
    {"writing the page", 1, one, 0, &Demo::write_page}};

Words Demo::with_common(Words words, bool quiet) const {
  if (common_.device != Common().device) words.insert(words.end(), {"--device", common_.device});
  if (!common_.max_memory.empty()) words.insert(words.end(), {"--max-memory", common_.max_memory});
  if (quiet) words.push_back("-q");
  return words;
}

void Demo::note(const Words& words, double seconds_before) {
  made_.commands.push_back({typed(words), seconds() - seconds_before});
}

int Demo::run_noted(const Words& words, bool talks) {
  const double before = seconds();
  const int code = run_words(with_common(words, common_.quiet || !(talks || common_.verbose)));
  note(words, before);
  return code;
}

Report Demo::evaluated(const fs::path& run) {
  const double before = seconds();
  Common quiet = common_;
  quiet.quiet = !common_.verbose;
  Report found = measure_run({.run = run.string()}, quiet);
  note({"eval", run.string()}, before);
  return found;
}

Report Demo::distance(const fs::path& set) {
  const double before = seconds();
  const DistanceRequest request{{(set / "pictures").string(), (made_.folders.training() / "pictures").string()},
                                request_.features};
  Report found = measure_distance(request, common_);
  note({"distance", request.folders[0], request.folders[1], "--features", request.features}, before);
  return found;
}

/// What hours of training are worth, before the minutes of this demo.
int Demo::show_shipped() {
  if (!ships_prior()) return 0;
  constexpr const char* kShown[] = {"Car", "Truck", "Bus"};
  for (const char* kind : kShown)
    run_noted({"generate", "-o", (made_.folders.first() / kind).string(), "-n", "2", "--class", kind, "--time", "day",
               "--size", "160", "--frames", "12", "--no-meshes"});
  return 0;
}

int Demo::make_streets() {
  return run_noted({"synth", "-o", made_.folders.logs().string(), "--logs", std::to_string(request_.logs), "--frames",
                    std::to_string(request_.frames), "--size", request_.size, "--cameras", "front,front_left",
                    "--night", "0.25", "--no-truth"},
                   true);
}

int Demo::reconstruct() {
  Words words = {"train", "genassets"};
  for (const fs::path& log : files_in(made_.folders.logs(), "", "")) words.push_back(log.string());
  words.insert(words.end(), {"-o", made_.folders.street().string(), "--preset", "genassets-small", "--holdout", "6"});
  if (request_.networks != kNone) words.insert(words.end(), {"--networks", request_.networks});
  // Small pictures want small patches, and more of them.
  Words settings = {"batch.patches=8", "batch.patch_side=24", "background.side=256"};
  settings.insert(settings.end(), request_.settings.begin(), request_.settings.end());
  for (const std::string& setting : settings) words.insert(words.end(), {"--set", setting});
  const int code = run_noted(with_schedule(words, request_, kStreetShare * budget_), true);
  if (code == 0) made_.street = evaluated(made_.folders.street());
  return code;
}

int Demo::learn_assets() {
  const int code = run_noted(with_schedule({"train", "diffusion", made_.folders.street().string(), "-o",
                                            made_.folders.prior().string(), "--preset", "diffusion-small"},
                                           request_, kPriorShare * budget_),
                             true);
  if (code == 0) made_.prior = evaluated(made_.folders.prior());
  return code;
}

int Demo::generate() {
  const std::string prior = made_.folders.prior().string();
  // No finer than what was learned from: 128 pixels for streets of 160x90.
  const int side = std::clamp(parse_size(request_.size).width * 4 / 5, 16, 128);
  const auto show = [&](const char* codes, const fs::path& folder, int count) {
    run_noted({"generate", prior, "-o", folder.string(), "-n", std::to_string(count), "--codes", codes, "--frames", "8",
               "--size", std::to_string(std::min(side, 64)), "--pictures", "--no-meshes"});
  };
  show("training", made_.folders.training(), kAllOfTraining);
  show("sampled", made_.folders.samples(), request_.assets);
  show("gaussian", made_.folders.gaussian(), request_.assets);
  show("random", made_.folders.random(), request_.assets);
  made_.samples = distance(made_.folders.samples());
  made_.gaussian = distance(made_.folders.gaussian());
  made_.random = distance(made_.folders.random());
  const auto kinds = kinds_in(made_.folders.training());
  std::map<std::string, int> counts;
  std::set<std::string> times;
  for (const auto& [kind, count] : kinds) {
    if (is_vehicle(asset_class(kind.first))) counts[kind.first] += count;
    times.insert(kind.second);
  }
  std::vector<std::pair<int, std::string>> classes;  // those that are most, first
  for (const auto& [name, count] : counts) classes.emplace_back(-count, name);
  std::sort(classes.begin(), classes.end());
  for (std::size_t i = 0; i < std::min(classes.size(), kClasses); ++i)
    for (const std::string& time : times)
      run_noted({"generate", prior, "-o", (made_.folders.assets() / folder_name(classes[i].second, time)).string(),
                 "-n", kEach, "--class", classes[i].second, "--time", time, "--size", std::to_string(side),
                 "--resolution", "48"});
  return 0;
}

int Demo::swap_vehicles() {
  const std::string street = made_.folders.street().string();
  run_noted({"render", street, "-o", made_.folders.before().string(), "--masks", "--exr"});
  const Swap swap = best_swap(made_.folders);
  made_.swapped_log = log_names(read_record(street)).at(static_cast<std::size_t>(swap.log));
  made_.swapped = swap.actors;
  Words words = {"edit", street, "--prior", made_.folders.prior().string(), "-o", made_.folders.edited().string()};
  for (const std::string& actor : swap.actors)
    words.insert(words.end(), {"--actor", made_.swapped_log + ":" + actor + ":replace=generated"});
  run_noted(words);
  return run_noted(
      {"render", made_.folders.edited().string(), "-o", made_.folders.after().string(), "--log", made_.swapped_log});
}

int Demo::write_page() {
  write_demo_page(made_);
  return 0;
}

/// By how fast this machine was so far; as parts differ, a range. Nothing while trainings of unknown length are ahead.
std::string Demo::time_left(std::size_t part) const {
  constexpr double kQuicker = 0.6, kSlower = 1.6;
  double work = 0, training = 0;
  for (std::size_t i = part; i < kParts.size(); ++i) {
    work += kParts[i].seconds * kParts[i].size(request_);
    training += kParts[i].share * budget_;
  }
  if (request_.steps > 0 && training > 0) return "";
  if (expected_ > 0) work *= (seconds() - trained(made_)) / expected_;
  return text("; ", words_for_seconds(training + kQuicker * work), " to ", words_for_seconds(training + kSlower * work),
              " left in total");
}

void Demo::tell(std::size_t part) const {
  say(common_, text("[", part + 1, "/", kParts.size(), "] ", kParts[part].what, time_left(part)));
}

int Demo::run() {
  clear(made_.folders);
  commit_text(made_.folders.record(), record_of(made_, seconds()).dump(2) + "\n");
  std::vector<std::string> parts;
  for (const Part& part : kParts) parts.emplace_back(part.what);
  GrowingPage page({made_.folders, parts});
  say(common_, text("to be seen while it fills: ", made_.folders.page().string()));
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    tell(i);
    page.begin_part(i);
    if (i + 1 == kParts.size()) page.end();  // this part writes it whole
    const int code = (this->*kParts[i].run)();
    commit_text(made_.folders.record(), record_of(made_, seconds()).dump(2) + "\n");
    if (code != 0) {
      say(common_, text("the finished parts are in ", request_.out));
      return code;
    }
    expected_ += kParts[i].seconds * kParts[i].size(request_);
  }
  if (common_.json) put_json(record_of(made_, seconds()));
  say(common_, text("done in ", words_for_seconds(seconds()), "\n", made_.folders.page().string()));
  return 0;
}

int run_demo(DemoRequest request, const Common& common) {
  open_device(common);
  features_named(request.features);  // a wrong file is told before minutes of work
  if (request.networks == kShipped && !ships_prior()) request.networks = kNone;
  if (request.networks != kNone) networks_named(request.networks);
  std::signal(SIGINT, leave);
  std::signal(SIGTERM, leave);
  try {
    return Demo(request, common).run();
  } catch (const Interrupted& interrupted) {
    throw Interrupted(interrupted.signal(), text(interrupted.what(), "\nthe finished parts are in ", request.out));
  }
}

}  // namespace

Command add_demo(CLI::App& program) {
  return command<DemoRequest>(program, "demo", kDemoExamples, run_demo, [](const Options& add, DemoRequest& r) {
    add("-o,--out", r.out, "Output folder (demo)");
    add("--time-budget", r.time_budget, "For both training runs together (9m); the rest takes a few minutes more");
    add("--features", r.features, "Weights of the feature network for distances (random)");
    add("--networks", r.networks, "Networks of this genassets run to begin with; none: learn them, too (shipped)");
    add("--logs", r.logs, "Number of streets (4)", whole_number(2, 100));
    add("--frames", r.frames, "Time steps of each street (12)", whole_number(2, 200));
    add("--size", r.size, "Image size, WIDTHxHEIGHT (160x90)");
    add("--assets", r.assets, "Number of assets to generate for the comparison (48)", whole_number(2, 1000));
    add("--steps", r.steps, "Steps of each training run, instead of a time budget", whole_number(1));
    add("--set", r.settings, "Setting key=value for the training on the streets; may be repeated").one_word();
  });
}

}  // namespace cloam
