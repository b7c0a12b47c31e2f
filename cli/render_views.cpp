// See render_views.h.
#include "cli/render_views.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>

#include "models/data/camera_file.h"
#include "models/eval/pictures.h"
#include "models/runs/actor_names.h"
#include "models/runs/captures.h"
#include "models/scene/camera_path.h"
#include "models/scene/orbit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

template <class Value>
bool parse(const std::string& word, Value& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

Camera at_size(const Camera& camera, const RestoredRun& run, const RenderRequest& request) {
  if (request.size.empty()) return scaled(camera, run.record.reading.downscale);
  const ImageSize size = parse_size(request.size);
  return resized(camera, size.width, size.height);
}

const Camera& camera_of(const Scene& scene, const Frame& frame) {
  return scene.cameras[static_cast<std::size_t>(frame.camera)];
}

void check_camera_name(const Scene& scene, const std::string& name) {
  std::vector<std::string> names;
  for (const Frame& frame : scene.frames)
    if (std::find(names.begin(), names.end(), frame.sensor) == names.end()) names.push_back(frame.sensor);
  if (std::find(names.begin(), names.end(), name) != names.end()) return;
  if (!scene.is_log)
    throw Error(Fault::usage, text("--camera-name ", name, ": the run has photos; cameras of driving logs have names"));
  throw Error(Fault::usage,
              text("--camera-name ", name, ": the cameras are ", joined(names), did_you_mean(name, names)));
}

std::vector<std::size_t> frames_of_choice(const Scene& scene, const RenderRequest& request) {
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    const Frame& frame = scene.frames[i];
    const Split wanted = request.split == "test" ? Split::test : Split::train;
    const bool in_split = request.step ? frame.step == *request.step : request.split == "all" || frame.split == wanted;
    if (in_split && (request.camera_name.empty() || frame.sensor == request.camera_name)) frames.push_back(i);
  }
  return frames;
}

std::vector<NamedView> capture_views(const Scene& scene, int index, const RestoredRun& run,
                                     const RenderRequest& request) {
  std::vector<std::size_t> frames = frames_of_choice(scene, request);
  if (frames.empty() && request.split == "test" && !request.step) {
    warn("no view was held out: rendering the training views");
    RenderRequest train = request;
    train.split = "train";
    frames = frames_of_choice(scene, train);
  }
  const std::vector<std::string> names = file_names(scene, frames);
  std::vector<NamedView> views;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Frame& frame = scene.frames[frames[i]];
    views.push_back({names[i], view_of(frame, at_size(camera_of(scene, frame), run, request), index)});
  }
  return views;
}

double time_asked_for(const std::vector<const Frame*>& frames, const std::string& word) {
  const bool after_start = word.starts_with("+");
  double seconds = 0;
  if (!parse(word.substr(after_start ? 1 : 0), seconds) || !std::isfinite(seconds))
    throw Error(Fault::usage,
                text("--time ", word, ": want seconds on the log's clock, or +1.5 after its first image"));
  return seconds + (after_start ? frames.front()->timestamp.value_or(0) : 0);
}

/// A camera moves between its images as actors do between their boxes.
NamedView view_at_time(const Scene& scene, int index, const RestoredRun& run, const RenderRequest& request) {
  const std::string sensor = request.camera_name.empty() ? front_sensor(scene) : request.camera_name;
  std::vector<const Frame*> frames;
  for (const Frame& frame : scene.frames)
    if (frame.sensor == sensor && frame.timestamp) frames.push_back(&frame);
  if (frames.empty()) throw Error(Fault::usage, "--time: the images have no time stamps; give --step or --camera");
  std::sort(frames.begin(), frames.end(), [](const Frame* a, const Frame* b) { return *a->timestamp < *b->timestamp; });
  Actor mover;
  for (const Frame* frame : frames) mover.boxes.push_back({frame->step, *frame->timestamp, frame->world_from_camera});
  const double time = time_asked_for(frames, request.time);
  const auto pose = world_from_box_at(mover, time);
  if (!pose)
    throw Error(Fault::usage, fmt::format("--time {}: {} has images from {:.3f} to {:.3f} s", request.time, sensor,
                                          *frames.front()->timestamp, *frames.back()->timestamp));
  return {fmt::format("{}_{:.3f}", sensor, time),
          {at_size(camera_of(scene, *frames.front()), run, request), *pose, index, time}};
}

std::vector<NamedView> orbit_views(const Scene& scene, int index, const RestoredRun& run,
                                   const RenderRequest& request) {
  const Frame& first = scene.frames.front();
  const Camera camera = at_size(camera_of(scene, first), run, request);
  std::vector<NamedView> views;
  for (const Eigen::Matrix4d& pose : orbit_poses(scene, request.frames))
    views.push_back({fmt::format("orbit_{:04}", views.size()), {camera, pose, index, first.timestamp.value_or(0)}});
  return views;
}

/// Through the cameras of photos, or of one camera of a log.
std::vector<NamedView> interpolated_views(const Scene& scene, int index, const RestoredRun& run,
                                          const RenderRequest& request) {
  const std::string sensor = request.camera_name.empty() ? front_sensor(scene) : request.camera_name;
  const std::vector<Frame> stops = frames_in_order(scene, sensor);
  const Camera camera = at_size(camera_of(scene, stops.front()), run, request);
  std::vector<NamedView> views;
  for (const CameraMoment& moment : interpolated_path(stops, request.frames))
    views.push_back(
        {fmt::format("interpolated_{:04}", views.size()), {camera, moment.world_from_camera, index, moment.time}});
  return views;
}

std::vector<NamedView> file_views(const RestoredRun& run, const RenderRequest& request) {
  const int log = request.log.empty() ? 0 : scenes_asked_for(run, request).front();
  std::vector<NamedView> views;
  for (View view : read_camera_file(request.camera, log_names(run.record), log)) {
    if (!request.size.empty()) view.camera = at_size(view.camera, run, request);
    views.push_back({fmt::format("{}_{:04}", kCameraFileViews, views.size()), view});
  }
  return views;
}

}  // namespace

std::vector<int> scenes_asked_for(const RestoredRun& run, const RenderRequest& request) {
  const std::vector<std::string> names = log_names(run.record);
  if (!request.log.empty()) return {find_log(names, request.log)};
  std::vector<int> all(names.size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

std::vector<NamedView> views_of(const RestoredRun& run, const RenderRequest& request) {
  if (!request.camera.empty()) return file_views(run, request);
  std::vector<int> scenes = scenes_asked_for(run, request);
  if (!request.path.empty() || !request.data.empty()) scenes.resize(1);
  std::vector<NamedView> views;
  for (const int index : scenes) {
    const Scene scene = request.data.empty()
                            ? run.scenes[static_cast<std::size_t>(index)]
                            : read_split_scene(request.data, reading_for(run.record, true, request.allow_outside));
    if (!request.camera_name.empty()) check_camera_name(scene, request.camera_name);
    std::vector<NamedView> more;
    if (request.path == "interpolated")
      more = interpolated_views(scene, index, run, request);
    else if (!request.path.empty())
      more = orbit_views(scene, index, run, request);
    else if (!request.time.empty())
      more = {view_at_time(scene, index, run, request)};
    else
      more = capture_views(scene, index, run, request);
    for (NamedView& view : more) {
      if (scenes.size() > 1) view.name = log_names(run.record)[static_cast<std::size_t>(index)] + "_" + view.name;
      views.push_back(std::move(view));
    }
  }
  return views;
}

}  // namespace cloam
