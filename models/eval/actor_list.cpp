// See actor_list.h.
#include "models/eval/actor_list.h"

#include <Eigen/Dense>

#include "models/eval/pictures.h"
#include "models/runs/actor_names.h"
#include "models/scene/edit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr int kThumbnail = 128, kColumns = 8;

/// Images in whose view the centre of the actor's box is.
std::size_t images_of(const Scene& scene, const Actor& actor) {
  std::size_t count = 0;
  for (const Frame& frame : scene.frames) {
    const auto box = world_from_box_at(actor, frame.timestamp.value_or(0));
    if (!box) continue;
    const Eigen::Vector4d centre = frame.world_from_camera.inverse() * box->col(3);
    const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
    if (centre.z() <= 0) continue;
    const Eigen::Vector2d at = project(camera, centre.head<3>());
    count += at.x() >= 0 && at.x() < camera.width && at.y() >= 0 && at.y() < camera.height;
  }
  return count;
}

std::string words_for_looks(const Scenes& scenes, const AssetName& appearance) {
  const auto logs = static_cast<int>(scenes.size());
  return appearance.scene < logs ? spelled(scenes, appearance) : text("generated ", appearance.scene - logs);
}

Report row_of(const Scenes& scenes, int log, const Actor& actor, std::size_t place) {
  const Scene& scene = scenes[static_cast<std::size_t>(log)];
  Report row = {{"number", place + 1},
                {"log", log},
                {"actor", actor.id},
                {"short_id", short_id(scenes, {log, actor.id})},
                {"label", actor.label},
                {"size_m", {actor.size.x(), actor.size.y(), actor.size.z()}},
                {"boxes", actor.boxes.size()},
                {"images", images_of(scene, actor)},
                {"stationary", actor.stationary},
                {"looks_of", actor.asset ? Report(words_for_looks(scenes, *actor.asset)) : Report()},
                {"row", place / kColumns + 1},
                {"column", place % kColumns + 1}};
  return row;
}

}  // namespace

Report list_of_actors(const RestoredRun& run) {
  Report report = {{"schema_version", 1}, {"logs", Report::array()}, {"actors", Report::array()}};
  const std::vector<std::string> names = log_names(run.record);
  for (std::size_t log = 0; log < run.scenes.size(); ++log) {
    const std::vector<Moment> moments = moments_of(run.scenes[log]);
    Report entry = {{"name", names[log]}, {"steps", moments.size()}};
    if (!moments.empty())
      entry["first_time"] = moments.front().timestamp, entry["last_time"] = moments.back().timestamp;
    report["logs"].push_back(entry);
    for (const Actor& actor : run.scenes[log].actors) {
      report["actors"].push_back(row_of(run.scenes, static_cast<int>(log), actor, report["actors"].size()));
    }
  }
  return report;
}

fs::path write_thumbnails(const RestoredRun& run, const Report& list, const fs::path& folder) {
  std::vector<Image> images;
  std::vector<Caption> captions;
  for (std::size_t log = 0; log < run.scenes.size(); ++log) {
    for (const Actor& actor : run.scenes[log].actors) {
      const AssetName appearance = actor.asset.value_or(AssetName{static_cast<int>(log), actor.id});
      images.push_back(three_quarter_picture(street_of(run), appearance, actor.size, kThumbnail));
    }
  }
  for (const Report& row : list["actors"])
    captions.push_back(
        {text(row["number"], "  ", row["short_id"].get<std::string>()), row["label"].get<std::string>()});
  const fs::path path = folder / "actors.png";
  write_png(path, contact_sheet(images, kColumns, captions));
  return path;
}

}  // namespace cloam
