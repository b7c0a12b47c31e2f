// `export --format capture`: photos with the poses and lenses, or a log with those and the boxes, that a run
// learned.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cli/export.h"
#include "cli/stop_signal.h"
#include "models/data/pandaset.h"
#include "models/data/refined_log.h"
#include "models/data/write_transforms.h"
#include "models/methods/registry.h"
#include "models/runs/captures.h"
#include "models/runs/recorded_log.h"
#include "models/scene/split.h"
#include "models/street/refines_boxes.h"
#include "models/train/refines_cameras.h"
#include "runtime/error.h"

namespace cloam {
namespace {

/// All of it, also what the run did not learn from: test photos, and boxes of what is no actor.
Scene scene_as_listed(const RestoredRun& run, const std::string& folder) {
  Reading how = reading_for(run.record, false, false);
  how.actors = ActorChoice::all;
  return read_scene_as_listed(find_data(folder, run.record.data.front()), how);
}

/// What a run learned of its photos.
struct LearnedPhotos {
  std::map<std::string, Eigen::Matrix4d> poses;  // of the training photos by name; empty: as given
  std::vector<LensChange> lenses;                // of Scene::cameras; empty: as given
  std::vector<Actor> actors;                     // of a log, where its boxes were learned; else empty
};

/// Of the photos that were moved, how far in the mean.
struct Moved {
  double degrees = 0, shift = 0;
};

Moved move_photos(Scene& scene, const std::map<std::string, Eigen::Matrix4d>& poses) {
  Moved out;
  const auto count = static_cast<double>(poses.size());
  for (Frame& frame : scene.frames) {
    const auto found = poses.find(frame.name);
    if (found == poses.end()) continue;
    const Eigen::Matrix4d by = frame.world_from_camera.inverse() * found->second;
    out.degrees +=
        Eigen::AngleAxisd(Eigen::Matrix3d(by.topLeftCorner<3, 3>())).angle() * 180 / std::numbers::pi / count;
    out.shift += by.topRightCorner<3, 1>().norm() / count;
    frame.world_from_camera = found->second;
  }
  return out;
}

/// In the mean over all lenses; pixels of the photos as they are listed.
struct ChangedLenses {
  double focal_percent = 0, centre_pixels = 0;
};

ChangedLenses change_lenses(Scene& scene, const std::vector<LensChange>& changes) {
  ChangedLenses out;
  const auto count = static_cast<double>(changes.size());
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const Camera given = scene.cameras.at(i);
    Camera& camera = scene.cameras[i] = with_lens(given, changes[i]);
    out.focal_percent += 100 * std::abs(changes[i].focal - 1) / count;
    out.centre_pixels += std::hypot(camera.cx - given.cx, camera.cy - given.cy) / count;
  }
  return out;
}

/// Metres that the learned boxes are from those given, of the boxes that moved.
std::vector<double> shifts_of(const std::vector<Actor>& learned, const std::vector<Actor>& given) {
  std::vector<double> out;
  for (std::size_t a = 0; a < learned.size(); ++a)
    for (std::size_t b = 0; b < learned[a].boxes.size(); ++b) {
      const Eigen::Matrix4d moved = learned[a].boxes[b].world_from_box - given.at(a).boxes.at(b).world_from_box;
      if (!moved.isZero(0)) out.push_back(moved.topRightCorner<3, 1>().norm());
    }
  std::sort(out.begin(), out.end());
  return out;
}

/// What is told of boxes that were written.
struct MovedBoxes {
  std::size_t count;
  double median;  // metres
  std::string words;
};
MovedBoxes moved_boxes(const std::vector<Actor>& learned, const std::vector<Actor>& given) {
  const std::vector<double> shifts = shifts_of(learned, given);
  const double median = shifts.empty() ? 0 : shifts[shifts.size() / 2];
  return {shifts.size(), median,
          fmt::format("{} refined boxes, {:.3f} m (median) from where they were given", shifts.size(), median)};
}

void move_boxes(Scene& log, const std::vector<Actor>& learned) {
  for (const Actor& from : learned)
    for (Actor& to : log.actors)
      if (to.id == from.id)
        for (ActorBox& box : to.boxes)
          if (const ActorBox* other = box_at_step(from, box.step)) box.world_from_box = other->world_from_box;
}

/// The log with what was learned of it: its own files where they have room for that, else in PandaSet's layout.
/// moved: `listed` with the cameras that were learned.
void write_log(const RestoredRun& run, const Scene& listed, Scene moved, const RefinedLog& refined,
               const ExportRequest& request, const Common& common) {
  if (has_room_for(refined, listed)) return write_refined_log(request.out, listed, refined);
  move_boxes(moved, refined.actors);
  say(common,
      listed.format == "PandaSet"
          ? "writing all of the log anew: in its own files, other cameras would move the LiDAR or lie between stamps"
          : "writing the log in PandaSet's layout: cloam does not write that of " + listed.format);
  const StopOnSignal signals("finishing this photo or sweep");
  write_recorded_log(request.out, moved, run.record.reading.skip_bad, listener_of(common));
}

/// The photos of a run that learned their poses or lenses: a log as a log, others as a capture.
int export_photos(const RestoredRun& run, const LearnedPhotos& photos, const ExportRequest& request,
                  const Common& common) {
  const Scene& learned = run.scenes.front();
  const Scene listed = scene_as_listed(run, request.run);
  RefinedLog refined{photos.actors, photos.poses, {}};
  Scene scene = listed;
  const Moved moved = move_photos(scene, refined.poses);
  const ChangedLenses lenses = change_lenses(scene, photos.lenses);
  if (!photos.lenses.empty())
    for (const Frame& frame : learned.frames)
      refined.lenses[frame.sensor] = photos.lenses.at(static_cast<std::size_t>(frame.camera));
  const bool as_log = listed.is_log && sensors_of(listed).size() <= std::size(kPandasetCameras);
  if (as_log)
    write_log(run, listed, scene, refined, request, common);
  else
    write_transforms(request.out, scene);
  const MovedBoxes boxes = moved_boxes(photos.actors, learned.actors);
  const bool with_boxes = as_log && !photos.actors.empty();
  if (common.json) {
    nlohmann::json told = {{"schema_version", 1},
                           {"path", request.out},
                           {"photos", scene.frames.size()},
                           {"refined", refined.poses.size()},
                           {"turned_degrees", moved.degrees},
                           {"shifted", moved.shift},
                           {"focal_percent", lenses.focal_percent},
                           {"centre_pixels", lenses.centre_pixels}};
    if (with_boxes) told.update({{"boxes_refined", boxes.count}, {"median_shift_m", boxes.median}});
    put_json(told);
  }
  std::string words = fmt::format("{}: {} photos", request.out, scene.frames.size());
  if (!refined.poses.empty())
    words += fmt::format(", {} with poses that were learned, in the mean {:.3f} degrees and {:.4g} {} from those given",
                         refined.poses.size(), moved.degrees, moved.shift, scene.metric ? "metres" : "scene units");
  if (!refined.poses.empty() && refined.poses.size() < scene.frames.size())
    words += "; photos that were held out have those given";
  if (lenses.focal_percent > 0) words += fmt::format("; focal lengths {:.2f} % from those given", lenses.focal_percent);
  if (lenses.centre_pixels > 0)
    words += fmt::format("; principal points {:.2f} pixels from those given", lenses.centre_pixels);
  if (with_boxes) words += "; " + boxes.words;
  if (listed.is_log && !as_log) words += "; photos alone, for a log has at most six cameras in PandaSet's layout";
  say(common, words);
  return 0;
}

/// The log of a run that learned where its boxes are, with those boxes.
int export_log(const RestoredRun& run, const std::vector<Actor>& actors, const ExportRequest& request,
               const Common& common) {
  const MovedBoxes boxes = moved_boxes(actors, run.scenes.front().actors);
  const Scene listed = scene_as_listed(run, request.run);
  write_log(run, listed, listed, {actors, {}, {}}, request, common);
  if (common.json)
    put_json({{"schema_version", 1},
              {"path", request.out},
              {"boxes_refined", boxes.count},
              {"median_shift_m", boxes.median}});
  say(common, fmt::format("{}: the log with {}", request.out, boxes.words));
  return 0;
}

}  // namespace

int export_capture(const RestoredRun& run, const ExportRequest& request, const Common& common) {
  if (const std::string problem = problem_of(output_folder(), request.out); !problem.empty())
    throw Error(Fault::usage, "--out: " + problem);
  LearnedPhotos photos;
  if (const auto* refines = as<RefinesCameras>(*run.method)) {
    photos.poses = poses_by_name(*refines, run.scenes.front(), 0);
    photos.lenses = refines->lens_changes(0);
  }
  if (const auto* refines = as<RefinesBoxes>(*run.method)) photos.actors = refines->refined_actors(0);
  const bool moved_photos = !photos.poses.empty() || !photos.lenses.empty();
  if ((moved_photos || !photos.actors.empty()) && run.scenes.size() > 1)
    throw Error(Fault::usage, text("--format capture: ", request.run, " learned the cameras or boxes of ",
                                   run.scenes.size(), " logs, and one log is written\n  fix: train on that log alone"));
  if (moved_photos) return export_photos(run, photos, request, common);
  if (!photos.actors.empty()) return export_log(run, photos.actors, request, common);
  throw Error(Fault::usage, text("--format capture: ", request.run,
                                 " learned neither poses, lenses nor boxes\n  fix: cloam train ", run.record.method,
                                 " DATA --set poses.refine=true, intrinsics.refine=true or intrinsics.centres=true",
                                 as<RefinesBoxes>(*run.method) ? " or actors.refine=true" : ""));
}

}  // namespace cloam
