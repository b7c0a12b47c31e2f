// See camera_motion.h.
#include "models/scene/camera_motion.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace cloam {

Eigen::Matrix4d CameraMotion::moved(double seconds) const {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  const double angle = turn.norm() * seconds;
  if (angle != 0) pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(angle, turn.normalized()).toRotationMatrix();
  pose.topRightCorner<3, 1>() = velocity * seconds;
  return pose;
}

CameraMotion camera_motion(const Scene& scene, const std::string& sensor, double time) {
  if (scene.recording.shutter <= 0) return {};
  std::vector<const Frame*> photos;
  for (const Frame& frame : scene.frames)
    if (frame.sensor == sensor && frame.timestamp) photos.push_back(&frame);
  std::sort(photos.begin(), photos.end(), [](const Frame* a, const Frame* b) { return *a->timestamp < *b->timestamp; });
  if (photos.size() < 2) return {};
  // A photo of that time has one on either side: their difference is the motion in the middle between them.
  const auto after = std::upper_bound(photos.begin(), photos.end(), time,
                                      [](double t, const Frame* frame) { return t < *frame->timestamp; });
  auto before = std::lower_bound(photos.begin(), photos.end(), time,
                                 [](const Frame* frame, double t) { return *frame->timestamp < t; });
  const Frame& next = after == photos.end() ? *photos.back() : **after;
  if (before == photos.begin()) before = photos.begin() + 1;
  const Frame* last = *(before - 1);
  if (last == &next) last = photos[photos.size() - 2];
  const double seconds = *next.timestamp - *last->timestamp;
  if (seconds <= 0) return {};
  const Eigen::Matrix4d change = last->world_from_camera.inverse() * next.world_from_camera;
  const Eigen::AngleAxisd turned(Eigen::Matrix3d(change.topLeftCorner<3, 3>()));
  CameraMotion motion;
  motion.shutter = scene.recording.shutter;
  motion.turn = turned.axis() * (turned.angle() / seconds);
  // The way lies in the axes of the photo before; the camera has turned on since.
  const double share = std::clamp((time - *last->timestamp) / seconds, 0.0, 1.0);
  const Eigen::Matrix3d since = Eigen::AngleAxisd(turned.angle() * share, turned.axis()).toRotationMatrix();
  motion.velocity = since.transpose() * Eigen::Vector3d(change.topRightCorner<3, 1>()) / seconds;
  return motion;
}

}  // namespace cloam
