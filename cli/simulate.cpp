// cloam simulate: an edited street as a driving log: images rendered, LiDAR measured where the edit touches it.
#include "models/train/simulate.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/actors.h"
#include "cli/commands.h"
#include "models/data/pandaset.h"
#include "models/data/read_scene.h"
#include "models/data/write_pandaset.h"
#include "models/scene/split.h"
#include "models/train/pictures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kExamples[] =
    R"(Write a log of a trained street, as edited, in PandaSet's layout: images, LiDAR and boxes that fit together.

Examples:
  cloam simulate runs/edited -o logs/without_car
  cloam simulate runs/edited -o logs/small --log 1 --cameras front_camera --size 320x180
  cloam check logs/without_car

Images are rendered at every frame. LiDAR returns that the edit does not touch are the recorded ones; where an actor was,
they are what lies behind it; where it is now, they are its own. docs/formats.md says how.)";

struct SimulateRequest {
  std::string run, out, log, cameras, size, data;
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
    std::string all;
    for (const std::string& word : known) all += (all.empty() ? "" : ", ") + word;
    throw Error(Fault::usage, text("--cameras ", list, ": the log has no camera '", name, "'; it has ", all));
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
    if (!whole) throw Error(Fault::usage, text("--size ", request.size, ": want WIDTHxHEIGHT, as 320x180"));
    out = resized(camera, width, height);
  }
  return {out.width, out.height, out.fx, out.fy, out.cx, out.cy, CameraModel::pinhole, {}, 0, 0};
}

/// What is to be written: the edited log with the cameras and names of the output, and labels of what is seen.
Scene output_log(const RestoredRun& run, int number, const SimulateRequest& request, const Common& common) {
  Scene log = run.scenes.at(static_cast<std::size_t>(number));
  for (Actor& actor : log.actors)
    actor.label = seen_label(run, {number, actor.id});
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
  throw Error(Fault::usage, text(out.string(), " exists; logs must not mix: name a new folder with -o"));
}

struct Count {
  std::size_t images = 0, sweeps = 0, returns = 0, measured = 0, changed = 0, gone = 0;
};

Image rendered(const RestoredRun& run, const Scene& out, const Frame& frame, int log) {
  const Camera& camera = out.cameras[static_cast<std::size_t>(frame.camera)];
  const Picture picture = run.method->render(view_of(frame, camera, log));
  return to_image(picture.rgb, picture.width, picture.height);
}

LidarPoints measured(const RestoredRun& run, const EditedLog& log, const Sweep& sweep, Count& count) {
  const auto recorded = std::find_if(log.recorded.sweeps.begin(), log.recorded.sweeps.end(),
                                     [&](const Sweep& s) { return s.step == sweep.step; });
  if (recorded == log.recorded.sweeps.end()) {
    throw Error(Fault::data, text(log.recorded.root.string(), ": the sweep of step ", sweep.step,
                                  " is gone; the run was trained with it. Name the whole log with --data"));
  }
  SweepEdit edit = edited_sweep(street_of(run), log, sweep, load_sweep(log.recorded, *recorded));
  ++count.sweeps;
  count.returns += edit.points.size();
  count.measured += edit.measured;
  count.changed += edit.changed;
  count.gone += edit.gone;
  return std::move(edit.points);
}

void tell(const Count& count, const SimulateRequest& request, const Common& common) {
  const nlohmann::ordered_json json = {{"schema_version", 1},
                                       {"folder", request.out},
                                       {"images", count.images},
                                       {"sweeps", count.sweeps},
                                       {"returns", count.returns},
                                       {"rays_measured", count.measured},
                                       {"returns_changed", count.changed},
                                       {"returns_gone", count.gone}};
  if (common.json) put(json.dump() + "\n");
  say(common,
      text("the log is ", request.out, ": ", count.images, " images, ", count.sweeps, " sweeps with ", count.returns,
           " returns (", count.changed, " changed, ", count.gone, " gone)\n  cloam check ", quoted(request.out)));
}

int run_command(const SimulateRequest& request, const Common& common) {
  const RunRecord record = read_record(request.run);  // a wrong folder is told before a missing device
  check_out(request.out);
  const std::vector<std::string> logs = log_names(record);
  const int log = request.log.empty() ? 0 : find_log(logs, request.log);
  const RunData& data = record.data.at(static_cast<std::size_t>(log));
  open_device(common);
  const RestoredRun run = restore_run(request.run);
  if (!run.checkpoint.warning.empty()) warn(run.checkpoint.warning);
  street_of(run);
  const Scene& edited = run.scenes.at(static_cast<std::size_t>(log));
  check_log(edited, request.run);
  const Scene recorded = read_scene(request.data.empty() ? find_data(request.run, data) : fs::path(request.data),
                                    {record.reading.skip_bad});
  const Scene out = output_log(run, log, request, common);
  if (logs.size() > 1) say(common, text("log ", log, " (", logs[static_cast<std::size_t>(log)], ") of ", logs.size()));
  Count count;
  const auto image = [&](const Frame& frame) {
    say(common, text("simulate ", ++count.images, "/", out.frames.size(), "  ", frame.sensor, " ", frame.step));
    return rendered(run, out, frame, log);
  };
  const auto points = [&](const Sweep& sweep) { return measured(run, {recorded, edited, log}, sweep, count); };
  write_pandaset(request.out, out, {image, points});
  tell(count, request, common);
  return 0;
}

}  // namespace

Command add_simulate(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("simulate", kExamples);
  const auto request = std::make_shared<SimulateRequest>();
  const auto common = std::make_shared<Common>();
  parser->add_option("RUN", request->run, "Run folder, edited or not")->required();
  parser->add_option("-o,--out", request->out, "Folder of the log")->required();
  parser->add_option("--log", request->log, "Number or name of the run's log (0)");
  parser->add_option("--cameras", request->cameras, "Cameras, separated by commas (all)");
  parser->add_option("--size", request->size, "Size of the images, WIDTHxHEIGHT (as trained)");
  parser->add_option("--data", request->data, "Where the recorded log lies now");
  add_common(*parser, *common);
  return {parser, [=] { return run_command(*request, *common); }};
}

}  // namespace cloam
