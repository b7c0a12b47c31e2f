// The LiDAR points of one sweep in memory.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// One entry a return; positions are [N, 3].
struct LidarPoints {
  std::vector<float> positions;       // metres, in the world frame
  std::vector<float> intensities;     // 0 to 1
  std::vector<float> times;           // seconds after the sweep's time stamp
  std::vector<std::uint8_t> sensors;  // 0: the LiDAR that turns, 1: the one that looks ahead
  std::size_t dropped = 0;            // returns with values that are no numbers, or further than 10^6 m
  std::size_t of_ego = 0;             // returns of the recording car, left out

  std::size_t size() const { return sensors.size(); }
};

/// From where and when a return of the sweep was seen.
inline SeenFrom seen_from(const Sweep& sweep, const LidarPoints& points, std::size_t i) {
  return seen_from(sweep, points.sensors[i], sweep.velocity ? double{points.times[i]} : 0);
}

}  // namespace cloam
