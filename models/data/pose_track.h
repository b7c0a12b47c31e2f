// The poses and times of one sensor of a log in PandaSet's layout.
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "models/io/json.h"

namespace cloam {

/// The entry of poses.json for a pose, world from sensor.
Json pose_entry(const Eigen::Matrix4d& pose);

/// poses.json and timestamps.json of a folder; each entry is looked at when it is asked for. An entry of poses.json is
/// the pose at the time stamp.
class PoseTrack {
 public:
  /// Of root/folder. Fault::data if the files do not list as many entries.
  PoseTrack(const std::filesystem::path& root, const std::string& folder);

  int steps() const { return static_cast<int>(poses_.size()); }
  /// Seconds. Fault::data, naming the entry, as all below.
  double time(int step) const;
  /// World from sensor, at the time stamp.
  Eigen::Matrix4d pose(int step) const;
  /// The pose at a time near the step's stamp: on the way from the step to its neighbour on that side; at an end of the
  /// track, straight on. 0 seconds after the stamp: the entry itself, to the bit.
  Eigen::Matrix4d pose_after(int step, double seconds) const;

 private:
  std::string folder_;
  Json poses_, times_;
};

}  // namespace cloam
