// See eval_photos.h.
#include "cli/eval_photos.h"

#include <algorithm>

#include "cli/capture.h"
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

void warn_of_training_photos(const Photos& photos) {
  std::size_t count = 0;
  for (const FramePixels& frame : photos.measured.frames)
    count += photos.train_scene.frames[frame.frame].split == Split::train;
  if (count > 0)
    warn(text(photos.name, ": ", count, " of the ", photos.measured.frames.size(),
              " photos that are measured were trained on: no fair figure"));
}

Photos own_photos(const RestoredRun& run, const EvalRequest& request, std::size_t index) {
  const RunData& data = run.record.data[index];
  const Reading how = reading_for(run.record, false, request.allow_outside);
  const std::string protocol = protocol_of(run, request);
  const bool other_protocol = protocol != how.protocol.name;
  Photos photos;
  const fs::path folder = find_data(request.run, data);
  photos.name = folder_name(folder);
  photos.image = how.image;
  photos.train_scene = read_split_scene(folder, how);
  if (fingerprint(photos.train_scene) != data.fingerprint)
    warn(text(photos.name, ": the data differs from what the run was trained on"));
  photos.scene = photos.train_scene;
  if (other_protocol) apply_protocol(photos.scene, {protocol, how.protocol.sparse_every});
  photos.train = load_images(photos.train_scene, Split::train, options_of(run));
  photos.measured = load_images(photos.scene, Split::test, options_of(run));
  photos.protocol = how.holdout > 0 ? text("holdout-", how.holdout) : "test-split";
  if (!protocol.empty()) photos.protocol = protocol;
  if (other_protocol) warn_of_training_photos(photos);
  if (!photos.measured.frames.empty() || !protocol.empty()) return photos;
  photos.measured = photos.train;
  photos.protocol = "train-images";
  warn("no image was held out: these are the training photos (train with --holdout 8 for a fair figure)");
  return photos;
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
  throw Error(Fault::usage, text("--data ", other, ": the run has several logs and none of that name; it has", names));
}

Photos other_photos(const RestoredRun& run, const EvalRequest& request) {
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
    warn(text("no baselines: ", error.what()));
    photos.train_scene = photos.scene;
    photos.train = {};
  }
  return photos;
}

}  // namespace

std::string protocol_of(const RestoredRun& run, const EvalRequest& request) {
  return request.protocol.empty() ? run.record.reading.protocol.name : request.protocol;
}

std::size_t count_scenes(const RestoredRun& run, const EvalRequest& request) {
  return request.other.empty() ? run.record.data.size() : 1;
}

Photos photos_of(const RestoredRun& run, const EvalRequest& request, std::size_t index) {
  Photos photos = request.other.empty() ? own_photos(run, request, index) : other_photos(run, request);
  if (request.other.empty()) photos.index = static_cast<int>(index);
  photos.options = options_of(run);
  for (const std::string& warning : photos.measured.warnings) warn(warning);
  return photos;
}

}  // namespace cloam
