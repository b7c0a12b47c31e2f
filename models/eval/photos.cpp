// See photos.h.
#include "models/eval/photos.h"

#include <algorithm>
#include <numeric>
#include <set>
#include <utility>

#include "models/runs/captures.h"
#include "models/train/refines_cameras.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

std::string folder_name(const fs::path& path) {
  std::error_code error;
  return fs::weakly_canonical(path, error).filename().string();
}

Pixels all_images(const Scene& scene, const LoadOptions& options) {
  Pixels all = load_images(scene, Split::train, options);
  Pixels more = load_images(scene, Split::test, options);
  for (FramePixels& frame : more.frames) {
    frame.camera = find_or_add(all.cameras, more.cameras[static_cast<std::size_t>(frame.camera)]);
    all.frames.push_back(std::move(frame));
  }
  return all;
}

LoadOptions options_of(const RestoredRun& run) {
  const Reading& how = run.record.reading;
  return {how.downscale, how.skip_bad, how.masks};
}

/// trained: the scene as the run's folder has it, whatever became of the data since.
void warn_of_training_photos(const Photos& photos, const Scene& trained, const Listener& listener) {
  std::set<std::string> names;
  for (const Frame& frame : trained.frames)
    if (frame.split == Split::train) names.insert(frame.image);
  std::size_t count = 0;
  for (const FramePixels& frame : photos.measured.frames)
    count += names.contains(photos.scene.frames[frame.frame].image);
  if (count > 0)
    listener.warn(text(photos.name, ": ", count, " of the ", photos.measured.frames.size(),
                       " evaluated images were used in training: their metrics are too optimistic"));
}

Photos own_photos(const RestoredRun& run, const EvalRequest& request, std::size_t index, const Listener& listener) {
  const RunData& data = run.record.data[index];
  const Reading how = reading_for(run.record, false, request.allow_outside);
  const std::string protocol = protocol_of(run, request);
  const bool other_protocol = protocol != how.protocol.name;
  Photos photos;
  const fs::path folder = find_data(request.run, data);
  photos.name = folder_name(folder);
  photos.image = how.image;
  photos.train_scene = read_split_scene(folder, how);
  const bool changed = fingerprint(photos.train_scene) != data.fingerprint;
  if (changed) listener.warn(text(folder.string(), " differs from what the run was trained on"));
  photos.scene = photos.train_scene;
  if (other_protocol) apply_protocol(photos.scene, {protocol, how.protocol.sparse_every});
  photos.train = load_images(photos.train_scene, Split::train, options_of(run));
  photos.measured = load_images(photos.scene, Split::test, options_of(run));
  photos.protocol = how.holdout > 0 ? text("holdout-", how.holdout) : "test-split";
  if (!protocol.empty()) photos.protocol = protocol;
  if (other_protocol || changed) warn_of_training_photos(photos, run.scenes[index], listener);
  if (!photos.measured.frames.empty() || !protocol.empty()) return photos;
  photos.measured = photos.train;
  photos.protocol = "train-images";
  listener.warn(
      "no images were held out, so the training images are evaluated; train with --holdout 8 for fair metrics");
  return photos;
}

std::string measured_in_words(const Reading& how) {
  if (how.holdout > 0) return text("its held-out images are evaluated (holdout-", how.holdout, ")");
  return how.protocol.name.empty() ? "its test split is evaluated" : text("protocol ", how.protocol.name);
}

/// The run's only scene, or the one whose folder has the same name.
std::size_t scene_named(const RestoredRun& run, const std::string& other) {
  if (run.record.data.size() == 1) return 0;
  std::string names;
  for (std::size_t i = 0; i < run.record.data.size(); ++i) {
    const std::string name = folder_name(run.record.data[i].given);
    if (name == folder_name(other)) return i;
    names += " " + name;
  }
  throw Error(Fault::usage, text("--data ", other, ": no log of the run has that name; its logs are", names));
}

Photos other_photos(const RestoredRun& run, const EvalRequest& request, const Listener& listener) {
  Photos photos;
  photos.index = static_cast<int>(scene_named(run, request.other));
  photos.name = folder_name(request.other);
  Reading how = reading_for(run.record, true, request.allow_outside);
  how.holdout = 0;
  how.image.clear();
  how.protocol = {request.protocol, how.protocol.sparse_every};
  photos.scene = read_split_scene(request.other, how);
  photos.measured = load_images(photos.scene, Split::test, options_of(run));
  photos.protocol = photos.measured.frames.empty() ? "all-images" : "test-split";
  if (photos.measured.frames.empty()) photos.measured = all_images(photos.scene, options_of(run));
  if (!request.protocol.empty()) photos.protocol = request.protocol;
  try {
    const RunData& data = run.record.data[static_cast<std::size_t>(photos.index)];
    photos.train_scene = read_split_scene(find_data(request.run, data), run.record.reading);
    photos.train = load_images(photos.train_scene, Split::train, options_of(run));
  } catch (const Error& error) {
    listener.warn(text("no baselines: ", error.what()));
    photos.train_scene = photos.scene;
    photos.train = {};
  }
  return photos;
}

/// Training photos stand where the run learned that they were taken.
void take_learned_poses(const RestoredRun& run, Photos& photos) {
  const auto* refines = as<RefinesCameras>(*run.method);
  if (!refines) return;
  const auto learned = poses_by_name(*refines, run.scenes.at(static_cast<std::size_t>(photos.index)), photos.index);
  for (Frame& frame : photos.scene.frames)
    if (const auto found = learned.find(frame.name); found != learned.end()) frame.world_from_camera = found->second;
}

}  // namespace

std::string protocol_of(const RestoredRun& run, const EvalRequest& request) {
  return request.protocol.empty() ? run.record.reading.protocol.name : request.protocol;
}

std::vector<std::size_t> scenes_to_measure(const RestoredRun& run, const EvalRequest& request) {
  if (request.scene) return {*request.scene};
  std::vector<std::size_t> all(request.other.empty() ? run.record.data.size() : 1);
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

void take_own_data(RestoredRun& run, EvalRequest& request, const Listener& listener) {
  if (request.other.empty()) return;
  const std::string found =
      fingerprint(read_scene_as_listed(request.other, reading_for(run.record, true, request.allow_outside)));
  for (std::size_t i = 0; i < run.record.data.size(); ++i) {
    RunData& data = run.record.data[i];
    if (data.fingerprint != found) continue;
    data = {request.other, relative_to_run(request.other, run.folder), found};
    request.scene = i;
    listener.say(text(request.other, " holds the run's own data: ", measured_in_words(run.record.reading)));
    request.other.clear();
    return;
  }
}

std::size_t take_learned_lenses(const RestoredRun& run, const Scene& scene, int index, Pixels& photos) {
  const auto* refines = as<RefinesCameras>(*run.method);
  const std::vector<LensChange> changes = refines ? refines->lens_changes(index) : std::vector<LensChange>();
  if (changes.empty()) return 0;
  std::size_t unknown = 0;
  const std::vector<Camera>& known = run.scenes.at(static_cast<std::size_t>(index)).cameras;
  const std::vector<Camera> given = std::exchange(photos.cameras, {});
  for (FramePixels& photo : photos.frames) {
    Camera camera = given[static_cast<std::size_t>(photo.camera)];
    const int listed = scene.frames[photo.frame].camera;
    const auto found = std::ranges::find(known, scene.cameras[static_cast<std::size_t>(listed)]);
    if (found == known.end())
      ++unknown;
    else
      camera = with_lens(camera, changes.at(static_cast<std::size_t>(found - known.begin())));
    photo.camera = find_or_add(photos.cameras, camera);
  }
  return unknown;
}

Photos photos_of(const RestoredRun& run, const EvalRequest& request, std::size_t index, const Listener& listener) {
  Photos photos =
      request.other.empty() ? own_photos(run, request, index, listener) : other_photos(run, request, listener);
  if (request.other.empty()) {
    photos.index = static_cast<int>(index);
    take_learned_poses(run, photos);
  }
  photos.options = options_of(run);
  if (const std::size_t unknown = take_learned_lenses(run, photos.scene, photos.index, photos.measured); unknown > 0)
    listener.warn(text(photos.name, ": ", unknown, " of ", photos.measured.frames.size(),
                       " images are of cameras with other numbers than the run's: they are seen through the lenses "
                       "given, not through those that the run learned"));
  take_learned_lenses(run, photos.train_scene, photos.index, photos.train);
  for (const std::string& warning : photos.measured.warnings) listener.warn(warning);
  return photos;
}

}  // namespace cloam
