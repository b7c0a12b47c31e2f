// See simulated_log.h.
#include "models/runs/simulated_log.h"

#include <algorithm>

#include "models/batches/log_source.h"
#include "models/data/as_pandaset.h"
#include "models/data/load_sweep.h"
#include "models/data/write_pandaset.h"
#include "models/io/words.h"
#include "models/runs/actor_names.h"
#include "models/runs/recorded_log.h"
#include "models/scene/split.h"
#include "models/street/refines_boxes.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

namespace cloam {
namespace {

void keep_cameras(Scene& log, std::vector<std::string> wanted) {
  if (wanted.empty()) return;
  const std::vector<std::string> known = sensors_of(log);
  for (std::string& name : wanted) {
    const auto is_known = [&](const std::string& word) {
      return std::find(known.begin(), known.end(), word) != known.end();
    };
    if (!is_known(name) && is_known(name + "_camera")) name += "_camera";
    if (is_known(name)) continue;
    throw Error(Fault::usage, text("--cameras: the log has no camera '", name, "'; it has ", joined(known),
                                   did_you_mean(name, known)));
  }
  std::erase_if(log.frames, [&](const Frame& frame) {
    return std::find(wanted.begin(), wanted.end(), frame.sensor) == wanted.end();
  });
}

/// The camera to render with: without a lens, which the layout cannot hold.
Camera output_camera(const Camera& camera, const std::optional<ImageSize>& size, int downscale) {
  const Camera out = size ? resized(camera, size->width, size->height) : scaled(camera, downscale);
  return {out.width, out.height, out.fx, out.fy, out.cx, out.cy, CameraModel::pinhole, {}, 0, 0};
}

}  // namespace

Scene output_log(const RestoredRun& run, const SimulatedLog& wish, const Listener& listener) {
  Scene log = run.scenes.at(static_cast<std::size_t>(wish.number));
  // Boxes where the pictures show the actors.
  if (const auto* refines = as<RefinesBoxes>(*run.method))
    if (auto learned = refines->refined_actors(wish.number); !learned.empty()) log.actors = std::move(learned);
  for (Actor& actor : log.actors) actor.label = seen_label(run, {wish.number, actor.id});
  keep_cameras(log, wish.cameras);
  std::vector<Camera> cameras;
  for (const Camera& camera : log.cameras)
    cameras.push_back(output_camera(camera, wish.size, run.record.reading.downscale));
  const PandasetLog out = as_pandaset(log, cameras);
  tell_renamed(out, listener);
  return out.scene;
}

LogCount& LogCount::operator+=(const LogCount& more) {
  images += more.images;
  sweeps += more.sweeps;
  returns += more.returns;
  measured += more.measured;
  changed += more.changed;
  gone += more.gone;
  return *this;
}

SimulatedLogWriter::SimulatedLogWriter(const RestoredRun& run, const SimulatedLog& wish, const Scene& out,
                                       std::filesystem::path folder)
    : run_(run),
      log_{wish.recorded, run.scenes.at(static_cast<std::size_t>(wish.number)), wish.number},
      out_(out),
      folder_(std::move(folder)) {}

std::string SimulatedLogWriter::image_name(std::size_t image) const {
  const Frame& frame = out_.frames.at(image);
  return text(frame.sensor, " ", frame.step);
}

std::string SimulatedLogWriter::sweep_name(std::size_t sweep) const {
  return text("sweep ", out_.sweeps.at(sweep).step);
}

LogCount SimulatedLogWriter::write_image(std::size_t image) const {
  const Frame& frame = out_.frames.at(image);
  const Camera& camera = out_.cameras.at(static_cast<std::size_t>(frame.camera));
  const Picture picture = as<RendersViews>(*run_.method)->render(view_of(frame, camera, log_.scene));
  write_pandaset_image(folder_, out_, frame, to_image(picture.rgb, picture.width, picture.height));
  return {.images = 1};
}

LogCount SimulatedLogWriter::write_sweep(std::size_t number) const {
  const Sweep& sweep = out_.sweeps.at(number);
  const auto recorded = std::find_if(log_.recorded.sweeps.begin(), log_.recorded.sweeps.end(),
                                     [&](const Sweep& s) { return s.step == sweep.step; });
  if (recorded == log_.recorded.sweeps.end()) {
    throw Error(Fault::data, text(log_.recorded.root.string(), ": the sweep of step ", sweep.step,
                                  " is missing, but the run was trained with it; name the complete log with --data"));
  }
  const SweepEdit edit = edited_sweep(street_of(run_), log_, sweep, load_sweep(log_.recorded, *recorded));
  write_pandaset_sweep(folder_, sweep, edit.points);
  return {0, 1, edit.points.size(), edit.measured, edit.changed, edit.gone};
}

void SimulatedLogWriter::write_rest() const { write_pandaset_rest(folder_, out_); }

}  // namespace cloam
