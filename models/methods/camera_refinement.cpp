// See camera_refinement.h.
#include "models/methods/camera_refinement.h"

#include <Eigen/LU>

#include "models/render/scene_frame.h"
#include "runtime/ops.h"

namespace cloam {

void bind_cameras(Config& config, CameraSettings& settings) {
  bind_poses(config, settings.poses);
  bind_lenses(config, settings.lenses);
}

void CameraRefinement::build(const CameraSettings& settings, const Scene& scene, Params& parameters,
                             const std::string& prefix, const std::optional<PoseScale>& scale) {
  poses_.build(settings.poses, scene, parameters, prefix, scale);
  lenses_.build(settings.lenses, scene, parameters, prefix);
}

void CameraRefinement::add_groups(ParameterGroups& groups) const {
  poses_.add_group(groups);
  lenses_.add_group(groups);
}

LearnedCameras CameraRefinement::of_pixels(const Tensor& poses, double scale) const {
  return {poses_.on() ? poses_.moved(poses, scale) : Tensor(), lenses_.lenses()};
}

ViewMove CameraRefinement::move_of(std::size_t photo, int camera) const {
  ViewMove move = poses_.move_of(photo);
  move.lens = lenses_.lens(camera);
  return move;
}

std::vector<Figure> CameraRefinement::figures() const {
  std::vector<Figure> out = poses_.figures();
  for (const Figure& figure : lenses_.figures()) out.push_back(figure);
  return out;
}

void LogCameras::build(const CameraSettings& settings, const Scene& scene, const Eigen::Matrix4d& log_from_world,
                       Params& parameters, const std::string& prefix) {
  learned_.build(settings, scene, parameters, prefix, kPoseScaleOfLogs);
  if (!learned_.on()) return;
  SceneFrame log;
  log.turn = log_from_world.topLeftCorner<3, 3>();
  log.centre = log_from_world.inverse().topRightCorner<3, 1>();
  std::vector<float> poses;
  photo_of_.assign(scene.frames.size(), -1);
  camera_of_.clear();
  for (const Frame& frame : scene.frames) camera_of_.push_back(frame.camera);
  for (const std::size_t frame : frames_of(scene, Split::train)) {
    photo_of_[frame] = static_cast<int32_t>(poses.size() / 12);
    append_pose(poses, scene.frames[frame].world_from_camera, log);
  }
  given_ = from_host(poses, {static_cast<int64_t>(poses.size() / 12), 12});
}

RaysInStreet LogCameras::moved(const RayList& rays, const std::vector<RaysOfPhoto>& photos) const {
  const int64_t count = rays.count();
  const RaysInStreet given = {from_host(rays.origins, {count, 3}), from_host(rays.directions, {count, 3})};
  std::vector<int32_t> photo, camera;
  for (const RaysOfPhoto& of : photos) {
    photo.insert(photo.end(), static_cast<std::size_t>(of.count), photo_of_[of.frame]);
    camera.insert(camera.end(), static_cast<std::size_t>(of.count), camera_of_[of.frame]);
  }
  if (photo.empty()) return given;
  const auto seen = static_cast<int64_t>(photo.size());
  const auto [poses, lenses] = learned_.of_pixels(given_, 1);
  const Tensor whose = from_host(photo, {seen}), from = gather_rows(given_, whose),
               to = poses ? gather_rows(poses, whose) : from;
  const auto axes = [&](const Tensor& of) { return reshape(slice(of, 1, 0, 9), {seen, 3, 3}); };
  const auto place = [&](const Tensor& of) { return slice(of, 1, 9, 12); };
  const auto in_camera = [&](const Tensor& v) { return sum(axes(from) * unsqueeze(v, 2), {{1}}); };
  const auto in_log = [&](const Tensor& v) { return sum(axes(to) * unsqueeze(v, 1), {{2}}); };
  const auto own = [&](const Tensor& of) { return slice(of, 0, 0, seen); };
  const auto with_others = [&](const Tensor& of, const Tensor& all) {
    return concat({of, slice(all, 0, seen, count)}, 0);
  };
  Tensor towards = in_camera(own(given.directions));
  if (!lenses.as_given()) {
    towards = directions_through(lenses_of(lenses, from_host(camera, {seen})), towards);
    towards = towards / sqrt(sum(square(towards), {{1}, true}));
  }
  return {with_others(place(to) + in_log(in_camera(own(given.origins) - place(from))), given.origins),
          with_others(in_log(towards), given.directions)};
}

}  // namespace cloam
