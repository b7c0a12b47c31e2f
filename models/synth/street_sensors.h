// Cameras and the LiDAR of the car that drives through a made street.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "models/data/load_sweep.h"
#include "models/io/image.h"
#include "models/scene/camera.h"
#include "models/synth/street_layout.h"

namespace cloam {

/// PandaSet's rig in small: the front camera with a long lens, five others with a wide one, all level.
struct Mount {
  const char* camera;
  double yaw;    // to the left of the car's front, radians
  double focal;  // in image widths
};
const Mount& mount_of(const std::string& camera);

Eigen::Matrix4d world_from_ego(const MadeStreet& street, double time);
Eigen::Matrix4d world_from_camera(const MadeStreet& street, const Mount& mount, double time);
Eigen::Matrix4d world_from_lidar(const MadeStreet& street, double time);

struct Exposure {
  const Mount* mount = nullptr;
  Camera camera;
  double time = 0;      // of the middle row
  double duration = 0;  // seconds from the first row to the last: a rolling shutter; 0: all rows at once
  double turn = 0;      // of all actors about their own z axes, counter-clockwise, radians
};

struct StreetPicture {
  Image image;                      // RGB, four samples a pixel
  std::vector<std::uint8_t> actor;  // number of the actor at the pixel's centre, 0: none; [height, width]
  std::vector<float> depth;         // metres along the optical axis at the pixel's centre, 0: sky
};
StreetPicture take_picture(const MadeStreet& street, const Exposure& exposure);

struct Spin {
  int beams = 32, columns = 720;
  double time = 0;
  bool moving = false;             // car and actors move while the LiDAR turns; else they stand as they are at `time`
  std::uint64_t seed = 0;          // of noise and drop-out
  std::optional<CarBox> car = {};  // the car's own body, which beams hit, in the axes of the LiDAR
};
/// Beams from 24 degrees below to 12 above; clockwise from the rear, and `times` are 0 where the beam looks ahead.
LidarPoints take_sweep(const MadeStreet& street, const Spin& spin);

/// A second LiDAR (sensor 1) at `place` in the axes of the first, which looks ahead: 60 degrees from left to right
/// while the first turns once, from 10 degrees below to 6 above with half as many beams. Its returns are added.
void add_ahead(const MadeStreet& street, const Spin& spin, const Eigen::Vector3d& place, LidarPoints& points);

}  // namespace cloam
