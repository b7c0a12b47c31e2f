// See log_builder.h.
#include "models/data/log_builder.h"

#include <algorithm>

#include "models/data/near_misses.h"
#include "models/data/poses.h"
#include "models/io/safetensors_header.h"  // printable

namespace cloam {
namespace {

constexpr double kLongestBox = 200;  // metres: a train

}  // namespace

LogBuilder::LogBuilder(const std::filesystem::path& root, const char* format, const ReadOptions& options)
    : options_(options) {
  scene.root = root;
  scene.format = format;
  scene.metric = scene.is_log = true;
}

void LogBuilder::add(const LabelledBox& labelled, const std::string& where) {
  guarded("box", [&] { add_sound(labelled, where); });
}

void LogBuilder::add_sound(const LabelledBox& labelled, const std::string& where) {
  const Eigen::Vector3d& size = labelled.size;
  ActorBox box = labelled.box;
  if (!box.world_from_box.allFinite() || !size.allFinite()) bad_data(where, ": a value is NaN or infinite");
  if (!(size.minCoeff() > 0) || size.maxCoeff() > kLongestBox)
    bad_data(where, ": implausible box size: ", size.x(), " by ", size.y(), " by ", size.z(), " m");
  box.world_from_box = rigid(box.world_from_box, where);
  Actor& actor = actors_[printable(labelled.id)];
  if (!actor.boxes.empty() && actor.boxes.back().step == box.step) {
    ++repeated_;
    return;
  }
  // Boxes of a track may differ a little; the largest holds them all.
  actor.size = actor.size.cwiseMax(size);
  actor.id = printable(labelled.id);
  if (actor.boxes.empty()) actor.label = labelled.label;
  actor.stationary = labelled.stationary;
  actor.boxes.push_back(box);
}

Scene LogBuilder::finish(const LookedFor& places) {
  for (auto& [id, actor] : actors_) scene.actors.push_back(std::move(actor));
  if (repeated_ > 0)
    scene.warnings.push_back(text(repeated_, " boxes dropped: their actors have another box at the same step"));
  if (!missing_.empty()) {
    scene.warnings.push_back(text(missing_.size(), " listed files are missing and skipped: ", some_of(missing_),
                                  near_misses(scene.root, missing_, false)));
  }
  if (scene.sweeps.empty()) scene.warnings.push_back(text("no LiDAR sweeps: looked for ", places.sweeps));
  if (scene.actors.empty()) scene.warnings.push_back(text("no boxes of actors: looked for ", places.boxes));
  if (scene.frames.empty())
    bad_data(scene.root.string(), ": no usable image: ", scene.frames_listed, " listed in ", places.images,
             missing_.empty() ? "" : "; looked for " + some_of(missing_), near_misses(scene.root, missing_, false),
             scene.frames_listed == 0 ? "; unpack all of the log, or give the folder that holds it"
                                      : "; copy the images there, or correct the list");
  return std::move(scene);
}

}  // namespace cloam
