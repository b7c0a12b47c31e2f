// How a driving log was recorded, as far as that is known: its clock, its LiDARs, and what of the car itself they see.
#pragma once
#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>

namespace cloam {

/// Where the recording car is, in the axes of the LiDAR that turns; metres.
struct CarBox {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(), size = Eigen::Vector3d::Zero();
  bool operator==(const CarBox&) const = default;
};

/// Defaults: all sensors see at their time stamps, and nothing more is known.
struct Recording {
  // A LiDAR turns clockwise from the car's rear on and so looks ahead in the middle of a sweep.
  double sweep_seconds = 0;  // that a turn takes; 0: all of a sweep counts as seen at once
  double sweep_stamp = 0;    // seconds from the middle of a sweep to its time stamp
  double image_stamp = 0;    // seconds from the exposure of an image's middle row to its time stamp
  double shutter = 0;        // seconds from an image's first row to its last (rolling shutter); 0: all rows at once
  Eigen::Vector3d ahead = Eigen::Vector3d::UnitY();  // to the car's front, in the axes of the LiDAR
  std::optional<Eigen::Matrix4d> front_from_lidar;   // front camera's axes from the LiDAR's, as they are mounted
  bool lidar_poses_wrong = false;                    // the log's own poses of its LiDAR are known to be
  std::optional<Eigen::Vector3d> second_lidar;       // place of the LiDAR that looks ahead, in the other's axes
  std::optional<CarBox> car;                         // returns in it are the car's own
  std::map<std::string, double> car_rows;            // by camera: share of the image's rows, lowest, with the car
  std::size_t poses_replaced = 0;                    // sweeps whose poses and times were taken from the front camera

  bool operator==(const Recording&) const = default;
};

}  // namespace cloam
