// cloam simulate: an edited street as a driving log: images rendered, LiDAR measured where the edit touches it.
#include "models/street/simulate.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/commands.h"
#include "cli/stop_signal.h"
#include "models/data/pandaset.h"
#include "models/data/read_scene.h"
#include "models/data/write_pandaset.h"
#include "models/eval/pictures.h"
#include "models/runs/actor_names.h"
#include "models/runs/asset_maker.h"
#include "models/runs/captures.h"
#include "models/scene/asset_class.h"
#include "models/scene/split.h"
#include "models/street/street_data.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr char kExamples[] =
    R"(Write a trained, edited street as a driving log in PandaSet's layout: consistent images, LiDAR and boxes.

Examples:
  cloam simulate runs/edited -o logs/without_car
  cloam simulate runs/edited -o logs/small --log 1 --cameras front_camera --size 320x180
  cloam check logs/without_car
  cloam simulate runs/street --augment 20 --prior runs/assets -o logs/augmented   20 logs with other vehicles

Every frame's image is rendered. LiDAR returns that the edit does not affect stay as recorded; where an actor was, they come
from what is behind it; where it is now, they come from the actor. docs/formats.md says how.

--augment N writes N logs, DIR/001 and so on: the same street and trajectories, but every vehicle is replaced by a new asset
of its class for the log's time of day, as replace=generated of cloam edit does.)";

struct SimulateRequest {
  std::string run, out, log, cameras, size, data, prior;
  int augment = 0;
  bool allow_outside = false;
  MakerWish wish;
};

/// Cameras of other sources get names that PandaSet has: the one that looks ahead is front_camera.
std::map<std::string, std::string> pandaset_names(const Scene& log) {
  std::vector<std::string> sensors = {front_sensor(log)},
                           free(std::begin(kPandasetCameras), std::end(kPandasetCameras));
  for (const Frame& frame : log.frames) {
    if (std::find(sensors.begin(), sensors.end(), frame.sensor) == sensors.end()) sensors.push_back(frame.sensor);
  }
  std::map<std::string, std::string> names;
  for (const std::string& sensor : sensors) {
    if (std::erase(free, sensor) > 0) names[sensor] = sensor;
  }
  for (const std::string& sensor : sensors) {
    if (names.contains(sensor)) continue;
    if (free.empty()) {
      throw Error(Fault::usage,
                  text("PandaSet's layout has six cameras, the log has ", sensors.size(), "; choose with --cameras"));
    }
    names[sensor] = free.front();
    free.erase(free.begin());
  }
  return names;
}

void keep_cameras(Scene& log, const std::string& list) {
  if (list.empty()) return;
  std::vector<std::string> known, wanted = CLI::detail::split(list, ',');
  for (const Frame& frame : log.frames) {
    if (std::find(known.begin(), known.end(), frame.sensor) == known.end()) known.push_back(frame.sensor);
  }
  for (std::string& name : wanted) {
    const auto is_known = [&](const std::string& word) {
      return std::find(known.begin(), known.end(), word) != known.end();
    };
    if (!is_known(name) && is_known(name + "_camera")) name += "_camera";
    if (is_known(name)) continue;
    throw Error(Fault::usage, text("--cameras ", list, ": the log has no camera '", name, "'; it has ", joined(known)));
  }
  std::erase_if(log.frames, [&](const Frame& frame) {
    return std::find(wanted.begin(), wanted.end(), frame.sensor) == wanted.end();
  });
}

/// The camera to render with: without a lens, which the layout cannot hold.
Camera output_camera(const Camera& camera, const SimulateRequest& request, int downscale) {
  Camera out = scaled(camera, downscale);
  if (!request.size.empty()) {
    int width = 0, height = 0, length = 0;
    const bool whole = std::sscanf(request.size.c_str(), "%5dx%5d%n", &width, &height, &length) == 2 &&
                       length == static_cast<int>(request.size.size()) && width > 0 && height > 0;
    if (!whole) throw Error(Fault::usage, text("--size ", request.size, ": want WIDTHxHEIGHT, such as 320x180"));
    out = resized(camera, width, height);
  }
  return {out.width, out.height, out.fx, out.fy, out.cx, out.cy, CameraModel::pinhole, {}, 0, 0};
}

/// What is to be written: the edited log with the cameras and names of the output, and labels of what is seen.
Scene output_log(const RestoredRun& run, int number, const SimulateRequest& request, const Common& common) {
  Scene log = run.scenes.at(static_cast<std::size_t>(number));
  for (Actor& actor : log.actors) actor.label = seen_label(run, {number, actor.id});
  keep_cameras(log, request.cameras);
  const auto names = pandaset_names(log);
  const std::vector<Camera> cameras = log.cameras;
  log.cameras.clear();
  for (Frame& frame : log.frames) {
    const Camera& camera = cameras[static_cast<std::size_t>(frame.camera)];
    frame.camera = find_or_add(log.cameras, output_camera(camera, request, run.record.reading.downscale));
    frame.sensor = names.at(frame.sensor);
  }
  for (const auto& [sensor, name] : names) {
    if (sensor != name) say(common, text("the camera ", sensor, " is written as ", name));
  }
  return log;
}

void check_log(const Scene& log, const std::string& run) {
  if (log.is_log && !log.frames.empty()) return;
  throw Error(Fault::usage, text("the run ", run, " is of photos, not of a driving log; simulate needs a log"));
}

void check_out(const fs::path& out) {
  std::error_code error;
  if (!fs::exists(out, error) || (fs::is_directory(out, error) && fs::is_empty(out, error))) return;
  throw Error(Fault::usage, text(out.string(), " exists; name a new folder with -o"));
}

struct Count {
  std::size_t images = 0, sweeps = 0, returns = 0, measured = 0, changed = 0, gone = 0;
};

Report report_of(const Count& count) {
  return {{"images", count.images},          {"sweeps", count.sweeps},           {"returns", count.returns},
          {"rays_measured", count.measured}, {"returns_changed", count.changed}, {"returns_gone", count.gone}};
}

std::string words_for(const Count& count) {
  return text(count.images, " images, ", count.sweeps, " sweeps with ", count.returns, " returns (", count.changed,
              " changed, ", count.gone, " gone)");
}

Image rendered(const RestoredRun& run, const Scene& out, const Frame& frame, int log) {
  const Camera& camera = out.cameras[static_cast<std::size_t>(frame.camera)];
  const Picture picture = as<RendersViews>(*run.method)->render(view_of(frame, camera, log));
  return to_image(picture.rgb, picture.width, picture.height);
}

LidarPoints measured(const RestoredRun& run, const EditedLog& log, const Sweep& sweep, Count& count) {
  const auto recorded = std::find_if(log.recorded.sweeps.begin(), log.recorded.sweeps.end(),
                                     [&](const Sweep& s) { return s.step == sweep.step; });
  if (recorded == log.recorded.sweeps.end()) {
    throw Error(Fault::data, text(log.recorded.root.string(), ": the sweep of step ", sweep.step,
                                  " is missing, but the run was trained with it; name the complete log with --data"));
  }
  SweepEdit edit = edited_sweep(street_of(run), log, sweep, load_sweep(log.recorded, *recorded));
  ++count.sweeps;
  count.returns += edit.points.size();
  count.measured += edit.measured;
  count.changed += edit.changed;
  count.gone += edit.gone;
  return std::move(edit.points);
}

class Simulation {
 public:
  Simulation(const SimulateRequest& request, const Common& common, int log, Scene recorded)
      : request_(request), common_(common), log_(log), recorded_(std::move(recorded)) {}

  /// Writes the log of the run as its scenes have it.
  Count write(const RestoredRun& run, const fs::path& folder) {
    const Scene out = output_log(run, log_, request_, common_);
    const Scene& edited = run.scenes.at(static_cast<std::size_t>(log_));
    begin(out);
    Count count;
    const auto image = [&](const Frame& frame) {
      ++count.images;
      return timed(images_, text(frame.sensor, " ", frame.step), [&] { return rendered(run, out, frame, log_); });
    };
    const auto points = [&](const Sweep& sweep) {
      return timed(sweeps_, text("sweep ", sweep.step), [&] {
        return measured(run, {recorded_, edited, log_}, sweep, count);
      });
    };
    const StopOnSignal signals("finishing this image or sweep");
    try {
      write_pandaset(folder, out, {image, points});
    } catch (const Interrupted& interrupted) {
      std::error_code error;
      fs::remove_all(folder, error);  // it is new: check_out
      throw Interrupted(interrupted.signal(),
                        text(interrupted.what(), "; ", folder.string(), " was incomplete and has been removed"));
    }
    return count;
  }

 private:
  struct Work {
    std::size_t done = 0, all = 0;
    double seconds = 0;
    double left() const { return seconds / static_cast<double>(done) * static_cast<double>(all - done); }
  };

  void begin(const Scene& out) {
    const auto logs = static_cast<std::size_t>(std::max(1, request_.augment));
    images_.all = logs * out.frames.size();
    sweeps_.all = logs * out.sweeps.size();
  }

  /// Does one image or sweep and says what is left.
  template <class Do>
  std::invoke_result_t<Do> timed(Work& work, const std::string& name, const Do& one) {
    check_stop([&] { return text(images_.done, " of ", images_.all, " images were rendered"); });
    const auto seconds = [] { return seconds_since_start() - device_stats().build_seconds; };  // kernels: only once
    const double before = seconds();
    auto result = one();
    work.seconds += seconds() - before;
    ++work.done;
    say(common_, text("simulate ", work.done, "/", work.all, "  ", name, "  ", left()));
    return result;
  }

  /// Images and sweeps take different times: what was not measured yet is not guessed.
  std::string left() const {
    if (sweeps_.done > 0 || sweeps_.all == 0) return words_for_seconds(images_.left() + sweeps_.left()) + " left";
    return text(words_for_seconds(images_.left()), " left for images, then ", sweeps_.all, " sweeps");
  }

  const SimulateRequest& request_;
  const Common& common_;
  const int log_;
  const Scene recorded_;
  Work images_, sweeps_;
};

int write_one(const SimulateRequest& request, const Common& common, Simulation& simulation, StoredRun stored) {
  const RestoredRun run = restore_run(std::move(stored));
  street_of(run);
  const Count count = simulation.write(run, request.out);
  Report report = {{"schema_version", 1}, {"folder", request.out}};
  report.update(report_of(count));
  if (common.json) put_json(report);
  say(common, text("the log is ", request.out, ": ", words_for(count), "\n  cloam check ", quoted(request.out)));
  return 0;
}

std::vector<AssetName> vehicles_of(const Scenes& scenes, int log) {
  std::vector<AssetName> names;
  for (const Actor& actor : scenes.at(static_cast<std::size_t>(log)).actors)
    if (!actor.boxes.empty() && is_vehicle(asset_class(actor.label))) names.push_back({log, actor.id});
  return names;
}

/// Gives every vehicle that is somewhere in the log a new asset; returns how many. Vehicles of a class that the prior
/// never saw stay as they are, which is told once for each class.
std::size_t swap_vehicles(AssetMaker& maker, const MakerWish& wish, int log, StoredRun& run, std::set<int>& told) {
  std::size_t swapped = 0;
  for (const AssetName& name : vehicles_of(run.scenes, log)) {
    const int kind = asset_class(actor_of(run.scenes, name).label);
    try {
      apply(maker.make(run, name, wish), run.scenes, name);
      ++swapped;
    } catch (const Error& error) {
      if (error.fault() != Fault::usage) throw;
      if (told.insert(kind).second) warn(text(kAssetClasses[kind], " is not replaced: ", error.what()));
    }
  }
  if (swapped > 0) return swapped;
  throw Error(Fault::data, "no vehicle of the log can be replaced: the --prior run learned none of their classes");
}

int write_augmented(const SimulateRequest& request, const Common& common, int log, Simulation& simulation,
                    const StoredRun& stored) {
  AssetMaker maker(request.prior, stored);
  std::set<int> told;
  Report report = {{"schema_version", 1}, {"folder", request.out}, {"logs", Report::array()}};
  for (int number = 1; number <= request.augment; ++number) {
    char name[16];
    std::snprintf(name, sizeof name, "%03d", number);
    const MakerWish wish{HostRandom(request.wish.seed, static_cast<uint64_t>(number)).next() >> 32,
                         request.wish.guidance};
    StoredRun swapped = stored;
    const std::size_t vehicles = swap_vehicles(maker, wish, log, swapped, told);
    const fs::path folder = fs::path(request.out) / name;
    const Count count = simulation.write(restore_run(std::move(swapped)), folder);
    Report row = {{"folder", folder.string()}, {"seed", wish.seed}, {"vehicles", vehicles}};
    row.update(report_of(count));
    report["logs"].push_back(row);
    say(common, text(folder.string(), ": ", vehicles, " vehicles swapped, ", words_for(count)));
  }
  if (common.json) put_json(report);
  say(common, text(request.augment, " logs in ", request.out, "\n  cloam check ",
                   quoted((fs::path(request.out) / "001").string())));
  return 0;
}

/// Before work begins.
void check_request(const SimulateRequest& request) {
  check_has_views(read_record(request.run));
  if ((request.augment > 0) == request.prior.empty())
    throw Error(Fault::usage, text("--augment N and --prior RUN2 go together: RUN2, a diffusion run, makes the ",
                                   "vehicles\n  example: cloam simulate RUN --augment 20 --prior RUN2 -o DIR"));
  if (!request.prior.empty()) check_is_prior(read_record(request.prior), request.prior);
  check_out(request.out);
}

int run_command(const SimulateRequest& request, const Common& common) {
  check_request(request);  // a wrong folder is told before a missing device
  const RunRecord record = read_record(request.run);
  const std::vector<std::string> logs = log_names(record);
  const int log = request.log.empty() ? 0 : find_log(logs, request.log);
  open_device(common);
  StoredRun stored = read_run(request.run);
  if (!stored.checkpoint.warning.empty()) warn(stored.checkpoint.warning);
  check_log(stored.scenes.at(static_cast<std::size_t>(log)), request.run);
  const fs::path data = request.data.empty() ? find_data(request.run, record.data.at(static_cast<std::size_t>(log)))
                                             : fs::path(request.data);
  const Reading how = reading_for(record, !request.data.empty(), request.allow_outside);
  Simulation simulation(request, common, log, read_scene(data, {how.skip_bad, how.allow_outside}));
  if (logs.size() > 1) say(common, text("log ", log, " (", logs[static_cast<std::size_t>(log)], ") of ", logs.size()));
  return request.augment > 0 ? write_augmented(request, common, log, simulation, stored)
                             : write_one(request, common, simulation, std::move(stored));
}

}  // namespace

Command add_simulate(CLI::App& program) {
  return command<SimulateRequest>(
      program, "simulate", kExamples, run_command, [](const Options& add, SimulateRequest& r) {
        add("RUN", r.run, "Run folder, edited or not")->required();
        add("-o,--out", r.out, "Folder for the log; with --augment, for the logs")->required();
        add("--log", r.log, "Number or name of one of the run's logs (0)");
        add("--cameras", r.cameras, "Cameras, separated by commas (all)");
        add("--size", r.size, "Size of the images, WIDTHxHEIGHT (as trained)");
        add("--augment", r.augment, "Number of logs to write, each with other vehicles in the same places",
            whole_number(1, 100000));
        add("--prior", r.prior, "With --augment: diffusion run that makes the vehicles");
        add("--seed", r.wish.seed, "With --augment: random seed (0)", whole_number(0));
        add("--guidance", r.wish.guidance,
            "With --augment: classifier-free guidance; above 1 follows the class more closely (1)",
            number_from(0, 100));
        add("--data", r.data, "New location of the recorded log, if it was moved");
        add_allow_outside(add, r.allow_outside);
      });
}

}  // namespace cloam
