// See load_sweep.h.
#include "models/data/load_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "models/data/data_frame.h"
#include "models/data/paths.h"

namespace cloam {
namespace {

constexpr double kFarthest = 1e6;
constexpr double kFullIntensity = 255;

bool sound(const std::array<double, 5>& values) {
  const bool finite = std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
  return finite && std::all_of(values.begin(), values.begin() + 3, [](double x) { return std::abs(x) < kFarthest; });
}

}  // namespace

// PandaSet: x y z in the world, i from 0 to 255, t in absolute seconds, d the LiDAR.
LidarPoints load_sweep(const Scene& scene, const Sweep& sweep) {
  const DataFrame frame = read_data_frame(resolve_inside(scene.root, sweep.file));
  const auto x = frame.numbers("x"), y = frame.numbers("y"), z = frame.numbers("z"), i = frame.numbers("i"),
             t = frame.numbers("t");
  const auto d = frame.has("d") ? frame.numbers("d") : std::vector<double>(frame.rows(), 0);
  LidarPoints points;
  for (std::size_t row = 0; row < frame.rows(); ++row) {
    const std::array<double, 5> values = {x[row], y[row], z[row], i[row], t[row] - sweep.timestamp};
    if (!sound(values)) {
      ++points.dropped;
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) points.positions.push_back(static_cast<float>(values[axis]));
    points.intensities.push_back(static_cast<float>(std::clamp(values[3] / kFullIntensity, 0.0, 1.0)));
    points.times.push_back(static_cast<float>(values[4]));
    points.sensors.push_back(d[row] == 1 ? 1 : 0);
  }
  return points;
}

}  // namespace cloam
