// See view_run.h.
#include "cli/view_run.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/view_scene.h"
#include "models/eval/pictures.h"
#include "models/gaussians/exports_gaussians.h"
#include "models/io/image.h"
#include "models/latents/shows_assets.h"
#include "models/runs/actor_names.h"
#include "models/scene/camera_path.h"
#include "models/scene/orbit.h"
#include "models/scene/split.h"
#include "models/street/takes_edits.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;
using Eigen::Vector3d;

constexpr int kThumbnail = 128, kTourSide = 480, kTourViews = 48;
constexpr std::size_t kWarmFrames = 8;
const char* const kRequestOfPage = "the request";

/// The looks of an actor in words that hold no slash and need no escape: "0-12", or "2-0" of a generated asset.
std::string looks_word(const Scenes& scenes, const AssetName& looks) {
  if (static_cast<std::size_t>(looks.scene) >= scenes.size()) return text(looks.scene, "-0");
  const std::vector<Actor>& actors = scenes[static_cast<std::size_t>(looks.scene)].actors;
  return text(looks.scene, "-", &actor_of(scenes, looks) - actors.data());
}

/// "thumbnails/LOG-PLACE-WIDTH-LENGTH-HEIGHT": what is seen has a name of its own, so that a browser may keep it.
std::string thumbnail_word(const Scenes& scenes, const AssetName& looks, const Vector3d& size) {
  const auto millimetres = [](double metres) { return std::lround(1000 * metres); };
  return text(looks_word(scenes, looks), "-", millimetres(size.x()), "-", millimetres(size.y()), "-",
              millimetres(size.z()));
}

Report box_json(const Actor& actor, double time) {
  const auto pose = world_from_box_at(actor, time);
  if (!pose) return nullptr;
  return {{"centre", vector_json(pose->topRightCorner<3, 1>())},
          {"size", vector_json(actor.size)},
          {"yaw", std::atan2((*pose)(1, 0), (*pose)(0, 0))},
          {"world_from_box", pose_json(*pose)}};
}

/// How far along the ray the box begins; none where it is missed.
std::optional<double> distance_to(const Eigen::Matrix4d& world_from_box, const Vector3d& size, const Vector3d& origin,
                                  const Vector3d& direction) {
  const Eigen::Matrix4d box_from_world = world_from_box.inverse();
  const Vector3d at = (box_from_world * origin.homogeneous()).head<3>(),
                 way = box_from_world.topLeftCorner<3, 3>() * direction;
  const Eigen::Array3d a = (-0.5 * size - at).array() / way.array(), b = (0.5 * size - at).array() / way.array();
  const double enter = a.min(b).maxCoeff(), leave = a.max(b).minCoeff();
  return enter <= leave && leave > 0 ? std::optional(std::max(enter, 0.0)) : std::nullopt;
}

/// For the page to draw gaussians as the method does.
void add_drawing(const GaussianDrawing& drawing, Report& json) {
  json["kind"] = "gaussians";
  json["splats"] = "splats.ply";
  json["near"] = drawing.near;
  json["antialiased"] = drawing.antialiased;
  json["background"] = drawing.white ? "#ffffff" : "#000000";
}

/// The nearest actor whose box the ray meets before `depth` (0: nothing is there).
const Actor* actor_in_the_way(const Scene& scene, double time, const Vector3d& origin, const Vector3d& direction,
                              double depth) {
  const Actor* nearest = nullptr;
  double least = depth > 0 ? depth : std::numeric_limits<double>::infinity();
  for (const Actor& actor : scene.actors) {
    const auto pose = world_from_box_at(actor, time);
    const auto distance = pose ? distance_to(*pose, actor.size, origin, direction) : std::nullopt;
    if (distance && *distance < least) nearest = &actor, least = *distance;
  }
  return nearest;
}

}  // namespace

RunShown::RunShown(ViewedRun viewed, Events& events)
    : run_(std::move(viewed.run)),
      log_(viewed.log),
      title_(viewed.title),
      events_(events),
      frames_(require<RendersViews>(*run_.method, run_.record.method, "the viewer")),
      recorded_(run_, log_),
      edits_(run_, viewed.prior, viewed.find_prior),
      wears_generated_(!run_.generated.assets.empty()) {
  if (auto* takes = as<TakesEdits>(*run_.method)) takes->take_actors(run_.scenes);
  events_.tell("revision", {{"revision", revision_}});
}

/// Frames from all over the log, so that most of its actors are decoded before the first mouse moves.
void RunShown::warm_up() {
  const Scene& scene = scene_shown();
  std::vector<View> views;
  const std::size_t every = std::max<std::size_t>(1, scene.frames.size() / kWarmFrames);
  for (std::size_t i = 0; i < scene.frames.size(); i += every) {
    const Frame& frame = scene.frames[i];
    const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
    views.push_back(view_of(frame, scaled(camera, run_.record.reading.downscale), log_));
  }
  frames_.warm_up(views);
}

Street& RunShown::street() {
  if (auto* street = as<Street>(*run_.method)) return *street;
  throw Refused(404, "there are no actors here: they are those of a run on driving logs");
}

Answer RunShown::scene() {
  Report json = scene_of_captures(title_, run_.record.method, scene_shown(), run_.record.reading.downscale);
  if (const auto* exports = as<ExportsGaussians>(*run_.method)) add_drawing(exports->drawing(), json);
  json["street"] = as<Street>(*run_.method) != nullptr;
  json["revision"] = revision_;
  json["can_undo"] = edits_.can_undo();
  json["can_save"] = edits_.can_save();
  return json_answer(json);
}

Gaussians RunShown::gaussians() const {
  const auto* exports = as<ExportsGaussians>(*run_.method);
  return exports ? exports->gaussians() : Shown::gaussians();
}

std::vector<View> RunShown::tour() const {
  const Scene& scene = scene_shown();
  std::vector<View> views;
  const auto add = [&](const Frame& frame) {
    const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
    const int shrink = std::max(1, std::max(camera.width, camera.height) / kTourSide);
    views.push_back(view_of(frame, resized(camera, camera.width / shrink, camera.height / shrink), log_));
  };
  if (scene.is_log) {
    for (const Frame& frame : frames_in_order(scene, front_sensor(scene))) add(frame);
    return views;
  }
  Frame frame = scene.frames.front();
  for (const Eigen::Matrix4d& pose : orbit_poses(scene, kTourViews)) frame.world_from_camera = pose, add(frame);
  return views;
}

Answer RunShown::frame(const FrameRequest& request, const std::function<void()>& between) {
  return frames_.frame(request, between);
}

Answer RunShown::actors(double time) {
  street();
  Report json = {{"time", time}, {"actors", Report::array()}, {"assets", Report::array()}};
  for (std::size_t log = 0; log < run_.scenes.size(); ++log)
    for (const Actor& actor : run_.scenes[log].actors) {
      const AssetName name{static_cast<int>(log), actor.id};
      const AssetName looks = appearance_of(run_.scenes, name);
      json["assets"].push_back({{"id", spelled(run_.scenes, name)},
                                {"name", short_id(run_.scenes, name)},
                                {"label", actor.label},
                                {"thumbnail", "thumbnails/" + thumbnail_word(run_.scenes, name, actor.size)}});
      if (static_cast<int>(log) != log_) continue;
      json["actors"].push_back({{"id", spelled(run_.scenes, name)},
                                {"name", short_id(run_.scenes, name)},
                                {"label", seen_label(run_, name)},
                                {"hidden", edits_.hides(name)},
                                {"box", box_json(edits_.shown(name), time)},
                                {"thumbnail", "thumbnails/" + thumbnail_word(run_.scenes, looks, actor.size)}});
    }
  return json_answer(json);
}

Answer RunShown::thumbnail(const std::string& name) {
  const auto known = thumbnails_.find(name);
  if (known != thumbnails_.end()) return {known->second, "image/jpeg"};
  for (std::size_t log = 0; log < run_.scenes.size(); ++log)
    for (const Actor& actor : run_.scenes[log].actors) {
      const AssetName own{static_cast<int>(log), actor.id};
      for (const AssetName& looks : {own, appearance_of(run_.scenes, own)}) {
        if (thumbnail_word(run_.scenes, looks, actor.size) != name) continue;
        const std::vector<std::uint8_t> bytes =
            jpeg_bytes(three_quarter_picture(street(), looks, actor.size, kThumbnail));
        return {thumbnails_[name] = {bytes.begin(), bytes.end()}, "image/jpeg"};
      }
    }
  throw Refused(404, "there is no such thumbnail: actors?time=0 names them");
}

/// What the model shows at that pixel; where it shows no actor, the nearest box before what it shows.
Answer RunShown::pick(const Json& request) {
  const View view = view_in(request, log_);
  const Vector3d ray =
      view.world_from_camera.topLeftCorner<3, 3>() *
      direction(view.camera, {number(request, "x", kRequestOfPage), number(request, "y", kRequestOfPage)}).normalized();
  const Vector3d origin = view.world_from_camera.topRightCorner<3, 1>();
  const Eigen::Vector3f o = origin.cast<float>(), d = ray.cast<float>();
  const LidarReturns seen = street().measure({log_, view.time, {o.begin(), o.end()}, {d.begin(), d.end()}});
  const Scene& scene = scene_shown();
  const Actor* actor = seen.actors.front() > 0
                           ? &scene.actors.at(static_cast<std::size_t>(seen.actors.front() - 1))
                           : actor_in_the_way(scene, view.time, origin, ray, double{seen.depths.front()});
  return json_answer({{"id", actor ? Report(spelled(run_.scenes, {log_, actor->id})) : Report()}});
}

/// The method takes the run's scenes; one that cannot is made anew from them.
void RunShown::show_edits() {
  auto* takes = as<TakesEdits>(*run_.method);
  if (!takes) {
    run_ = restore_run(StoredRun(run_));
    frames_.show(*as<RendersViews>(*run_.method));
    return;
  }
  const bool generated = !run_.generated.assets.empty();
  if (generated || wears_generated_) (void)as<ShowsAssets>(*run_.method)->show_assets(run_.generated.assets);
  wears_generated_ = generated;
  takes->take_actors(run_.scenes);
}

Answer RunShown::changed() {
  show_edits();
  const Report json = {{"revision", ++revision_}};
  events_.tell("revision", json);
  return json_answer(json);
}

Answer RunShown::edit(const Json& request) {
  street();
  edits_.apply(request);
  return changed();
}

Answer RunShown::undo() {
  street();
  edits_.undo();
  return changed();
}

Answer RunShown::save(const Json& request) {
  street();
  const std::string folder = string(request, "path", kRequestOfPage);
  edits_.save(folder);
  return json_answer({{"run", folder}});
}

}  // namespace cloam
