// See pose_track.h.
#include "models/data/pose_track.h"

#include <cmath>

#include "models/data/poses.h"
#include "models/scene/pose.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kMaxSteps = 100000;

const Json& entries(const Json& json, const std::string& where) {
  if (json.is_array() && json.size() <= kMaxSteps) return json;
  bad_data(where, ": looked for a list of at most ", kMaxSteps, " entries, found ",
           json.is_array() ? text(json.size()) : std::string(json.type_name()));
}

// {"position": {x, y, z}, "heading": {w, x, y, z}}: world from sensor.
Eigen::Matrix4d read_pose(const Json& json, const std::string& where) {
  const Json &position = member(json, "position", where), &heading = member(json, "heading", where);
  const Eigen::Quaterniond turn(number(heading, "w", where), number(heading, "x", where), number(heading, "y", where),
                                number(heading, "z", where));
  if (!(std::abs(turn.norm() - 1) < 0.01)) bad_data(where, ": the heading has length ", turn.norm(), ", want 1");
  const Eigen::Vector3d place(number(position, "x", where), number(position, "y", where), number(position, "z", where));
  return rigid(pose_from(turn.normalized().toRotationMatrix(), place), where);
}

}  // namespace

Json pose_entry(const Eigen::Matrix4d& pose) {
  const Eigen::Quaterniond turn(Eigen::Matrix3d(pose.topLeftCorner<3, 3>()));
  return {{"position", {{"x", pose(0, 3)}, {"y", pose(1, 3)}, {"z", pose(2, 3)}}},
          {"heading", {{"w", turn.w()}, {"x", turn.x()}, {"y", turn.y()}, {"z", turn.z()}}}};
}

PoseTrack::PoseTrack(const std::filesystem::path& root, const std::string& folder)
    : folder_(folder),
      poses_(parse_json_file(root / (folder + "/poses.json"))),
      times_(parse_json_file(root / (folder + "/timestamps.json"))) {
  const std::size_t count = entries(poses_, folder + "/poses.json").size(),
                    times = entries(times_, folder + "/timestamps.json").size();
  if (count != times) bad_data(folder, ": ", count, " poses but ", times, " time stamps");
}

double PoseTrack::time(int step) const {
  const Json& json = times_[std::size_t(step)];
  const double time = json.is_number() ? json.get<double>() : NAN;
  if (!std::isfinite(time)) bad_data(folder_, "/timestamps.json, entry ", step, ": looked for a time in seconds");
  return time;
}

Eigen::Matrix4d PoseTrack::pose(int step) const {
  return read_pose(poses_[std::size_t(step)], text(folder_, "/poses.json, entry ", step));
}

Eigen::Matrix4d PoseTrack::pose_after(int step, double seconds) const {
  const Eigen::Matrix4d here = pose(step);
  if (seconds == 0 || steps() < 2) return here;
  const bool later = seconds > 0 ? step + 1 < steps() : step == 0;
  const int other = later ? step + 1 : step - 1;
  const double gap = time(other) - time(step);
  if (!(std::abs(gap) > 1e-3)) return here;  // stamps that stand still say nothing of the way
  return pose_between(here, pose(other), seconds / gap);
}

}  // namespace cloam
