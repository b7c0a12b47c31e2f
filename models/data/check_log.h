// Do the parts of a driving log fit together: time stamps, boxes, LiDAR on images?
#pragma once
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// How well the LiDAR fits one camera's images. The strength of a return tells something of the brightness of its
/// pixel; how much (their mutual information over all images) is greatest where pose, intrinsics and time are right:
/// Pandey et al., Automatic targetless extrinsic calibration of a 3D lidar and camera by maximizing mutual information,
/// 2012.
struct LidarFit {
  std::string sensor;
  std::size_t images = 0;             // that were compared
  double points_per_image = 0;        // returns in front of the camera and inside the image
  double share_worse = 0;             // of 80 displacements of the points, how many fit worse than none: 1 is best
  double offset_x = 0, offset_y = 0;  // the displacement that fits best, in pixels
  int spacing = 1;                    // of the displacements, in pixels: what the offset is exact to

  bool aligned() const { return std::max(std::abs(offset_x), std::abs(offset_y)) <= spacing; }
};

/// What was found of the log's clock and of the car that recorded it; what is known of them is in Scene::recording.
struct ClockReport {
  std::map<std::string, double> cameras_after;     // seconds from sweeps to images, by camera; the median
  double first_box_after = 0, last_box_after = 0;  // seconds from sweeps to their earliest and latest boxes
  std::size_t second_lidar_points = 0;             // of the LiDAR that looks ahead
  std::size_t car_points = 0;                      // returns of the car itself, left out
  std::map<std::string, double> car_rows;          // share of the rows that show the car, left out; by camera
};

struct LogReport {
  int steps = 0;
  double seconds = 0, rate = 0;  // of the sweeps, or the first camera
  std::size_t sweeps = 0;
  double points_per_sweep = 0;
  std::size_t points_dropped = 0;  // values that are no numbers
  std::size_t actors = 0, boxes = 0, boxes_without_points = 0;
  ClockReport clock;
  std::vector<LidarFit> fits;  // one a camera, none without LiDAR
  std::vector<std::string> warnings;
};

/// Reads all sweeps, and images of at most 20 steps. Errors: as load_sweep and read_image; with
/// skip_bad sweeps and images that are damaged are warned of and left out.
LogReport check_log(const Scene& scene, bool skip_bad = false);

}  // namespace cloam
