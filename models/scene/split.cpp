// See split.h.
#include "models/scene/split.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kManyFrames = 40, kSparseOfMany = 10, kSparseOfFew = 5;

void hold_out_steps(Scene& log, int n) {
  const auto split = [&](int step) { return step % n == 0 ? Split::test : Split::train; };
  for (Frame& frame : log.frames) frame.split = split(frame.step);
  for (Sweep& sweep : log.sweeps) sweep.split = split(sweep.step);
}

void split_sparse(Scene& log, const std::string& front, int every) {
  std::set<int> steps, training;
  for (const Frame& frame : log.frames)
    if (frame.sensor == front) steps.insert(frame.step);
  if (steps.empty()) return;
  if (every == 0) every = steps.size() < kManyFrames ? kSparseOfFew : kSparseOfMany;
  for (const int step : steps)
    if (step % every == 0 || step == *steps.rbegin()) training.insert(step);
  for (Frame& frame : log.frames) {
    const Split split = training.contains(frame.step) ? Split::train : Split::test;
    frame.split = frame.sensor == front ? split : Split::unused;
  }
  for (Sweep& sweep : log.sweeps) sweep.split = training.contains(sweep.step) ? Split::train : Split::test;
}

void split_by_camera(Scene& log, const std::string& front, const std::string& measured) {
  for (Frame& frame : log.frames) {
    const Split other = frame.sensor == measured ? Split::test : Split::unused;
    frame.split = frame.sensor == front ? Split::train : other;
  }
  for (Sweep& sweep : log.sweeps) sweep.split = Split::train;
}

}  // namespace

void apply_holdout(Scene& scene, int n) {
  if (n < 2) {
    throw Error(Fault::usage, text("--holdout ", n, " leaves no image to train on: want 2 or more (8 is usual)"));
  }
  if (scene.is_log) return hold_out_steps(scene, n);
  std::vector<std::size_t> order(scene.frames.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scene.frames[a].image < scene.frames[b].image; });
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    scene.frames[order[rank]].split = rank % n == 0 ? Split::test : Split::train;
  }
}

const std::vector<std::string>& protocol_names() {
  static const std::vector<std::string> names = {"sparse", "novel", "rotate360"};
  return names;
}

void apply_protocol(Scene& scene, const Protocol& protocol) {
  if (!scene.is_log)
    throw Error(Fault::usage, text("--protocol ", protocol.name, " is for driving logs; ", scene.root.string(),
                                   " holds photos: use --holdout 8"));
  const std::string front = front_sensor(scene);
  if (protocol.name == "sparse") return split_sparse(scene, front, protocol.sparse_every);
  if (protocol.name == "novel") return split_by_camera(scene, front, kFrontLeftSensor);
  if (protocol.name == "rotate360") return split_by_camera(scene, front, "");
  throw Error(Fault::usage, text("--protocol ", protocol.name, ": want sparse, novel or rotate360"));
}

std::size_t frame_named(const Scene& scene, const std::string& image) {
  if (!scene.is_log)
    throw Error(Fault::usage, text("--image ", image, " is for driving logs; ", scene.root.string(), " holds photos"));
  const std::size_t slash = image.rfind('/');
  const std::string sensor = image.substr(0, slash), digits = slash == std::string::npos ? "" : image.substr(slash + 1);
  const bool sound =
      !digits.empty() && digits.size() < 9 && digits.find_first_not_of("0123456789") == std::string::npos;
  const int step = sound ? std::stoi(digits) : -1;
  std::map<std::string, std::pair<int, int>> known;  // first and last step of each sensor
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    const Frame& frame = scene.frames[i];
    if (frame.sensor == sensor && frame.step == step) return i;
    auto& range = known.try_emplace(frame.sensor, frame.step, frame.step).first->second;
    range = {std::min(range.first, frame.step), std::max(range.second, frame.step)};
  }
  std::string there;
  std::vector<std::string> names;
  for (const auto& [name, range] : known) {
    names.push_back(name);
    there += text(there.empty() ? "" : ", ", name, "/", range.first, " to ", name, "/", range.second);
  }
  const std::string hint = known.contains(sensor) ? "" : did_you_mean(sensor, names);
  throw Error(Fault::usage,
              text("--image ", image, ": ", scene.root.string(), " has no such image; it has ", there, hint));
}

void apply_image(Scene& scene, const std::string& image) {
  const std::size_t chosen = frame_named(scene, image);
  for (std::size_t i = 0; i < scene.frames.size(); ++i)
    scene.frames[i].split = i == chosen ? Split::train : Split::unused;
  for (Sweep& sweep : scene.sweeps)
    sweep.split = sweep.step == scene.frames[chosen].step ? Split::train : Split::unused;
}

std::string front_sensor(const Scene& scene) {
  for (const char* name : {"front_camera", "image_02", "CAM_FRONT"}) {
    const auto is_it = [&](const Frame& frame) { return frame.sensor == name; };
    if (std::any_of(scene.frames.begin(), scene.frames.end(), is_it)) return name;
  }
  return scene.frames.empty() ? "" : scene.frames.front().sensor;
}

std::vector<std::string> sensors_of(const Scene& scene) {
  std::vector<std::string> sensors;
  for (const Frame& frame : scene.frames)
    if (std::find(sensors.begin(), sensors.end(), frame.sensor) == sensors.end()) sensors.push_back(frame.sensor);
  return sensors;
}

}  // namespace cloam
