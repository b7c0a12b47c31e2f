// Odd things about a scene that need no pixels to be seen (check_scene of read_scene.h).
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <map>
#include <set>

#include "models/data/read_scene.h"
#include "runtime/error.h"

namespace cloam {
namespace {

// Beyond it a float32 rounds places to more than half a pixel of a photo that is a thousand wide.
constexpr double kFarthestInExtents = 1e4;

void check_names(const Scene& scene, std::vector<std::string>& warnings) {
  std::set<std::string> seen;
  for (const Frame& frame : scene.frames) {
    if (!seen.insert(frame.image).second) warnings.push_back("the image " + frame.image + " is listed twice");
  }
}

// Equal to a millionth: written twice, not merely near.
void check_poses(const Scene& scene, std::vector<std::string>& warnings) {
  std::map<std::vector<long long>, std::string> seen;
  for (const Frame& frame : scene.frames) {
    std::vector<long long> key;
    for (const double value : frame.world_from_camera.reshaped()) key.push_back(std::llround(value * 1e6));
    if (frame.timestamp) key.push_back(std::llround(*frame.timestamp * 1e6));
    const auto [first, added] = seen.emplace(std::move(key), frame.image);
    if (!added) warnings.push_back(text(frame.image, " has the same pose as ", first->second));
  }
}

void check_origin(const Eigen::Vector3d& centre, double extent, std::vector<std::string>& warnings) {
  const double far = centre.norm();
  if (extent < 1e-3 || far < kFarthestInExtents * extent) return;
  warnings.push_back(fmt::format(
      "the cameras are {:.3g} units from the origin and {:.3g} from their centre: 32-bit floats round such "
      "positions, which costs sharpness; subtract {:.0f}, {:.0f}, {:.0f} from all positions (of points, too)",
      far, extent, centre.x(), centre.y(), centre.z()));
}

void check_scale(const Scene& scene, std::vector<std::string>& warnings) {
  if (scene.frames.size() < 2) return;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Frame& frame : scene.frames) centre += frame.world_from_camera.topRightCorner<3, 1>();
  centre /= static_cast<double>(scene.frames.size());
  std::vector<double> distances;
  for (const Frame& frame : scene.frames) {
    distances.push_back((frame.world_from_camera.topRightCorner<3, 1>() - centre).norm());
  }
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  const double median = distances[distances.size() / 2];
  if (median < 1e-3) warnings.push_back("all cameras are in one place: depth cannot be found from such views");
  if (median > 1e3) warnings.push_back(text("cameras are ", median, " units from their centre: is the scale right?"));
  if (!scene.is_log) check_origin(centre, median, warnings);  // of metres, whose readers refuse places too far away
}

}  // namespace

std::vector<std::string> check_scene(const Scene& scene) {
  std::vector<std::string> warnings;
  check_names(scene, warnings);
  check_poses(scene, warnings);
  check_scale(scene, warnings);
  return warnings;
}

}  // namespace cloam
