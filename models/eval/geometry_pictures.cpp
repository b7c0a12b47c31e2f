// See geometry_pictures.h.
#include "models/eval/geometry_pictures.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

constexpr double kCut = 0.02;   // share of the pixels beyond each end of the colours
constexpr double kLeast = 0.5;  // opacity of a surface
constexpr double kEdge = 0.2;   // of the depth: neighbours that differ by more lie on other surfaces

bool is_surface(const Picture& picture, std::size_t pixel) {
  return picture.depth[pixel] > 0 && static_cast<double>(picture.opacity[pixel]) >= kLeast;
}

/// A rainbow whose lightness rises and falls once: x from 0 (blue) to 1 (red).
Eigen::Vector3f rainbow(double x) {
  const auto wave = [&](double middle) {
    return static_cast<float>(std::clamp(1.5 - std::abs(4 * x - middle), 0.0, 1.0));
  };
  return {wave(3), wave(2), wave(1)};
}

std::vector<double> surface_depths(const Picture& picture) {
  std::vector<double> depths;
  for (std::size_t i = 0; i < picture.depth.size(); ++i)
    if (is_surface(picture, i)) depths.push_back(std::log(static_cast<double>(picture.depth[i])));
  std::sort(depths.begin(), depths.end());
  return depths;
}

}  // namespace

Image depth_picture(const Picture& picture) {
  std::vector<float> rgb(3 * picture.depth.size(), 0.f);
  const std::vector<double> depths = surface_depths(picture);
  if (!depths.empty()) {
    const auto last = static_cast<double>(depths.size() - 1);
    const double near = depths[static_cast<std::size_t>(kCut * last)],
                 far = depths[static_cast<std::size_t>((1 - kCut) * last)];
    for (std::size_t i = 0; i < picture.depth.size(); ++i) {
      if (!is_surface(picture, i)) continue;
      const double way = (std::log(static_cast<double>(picture.depth[i])) - near) / std::max(far - near, 1e-9);
      const Eigen::Vector3f colour = rainbow(1 - std::clamp(way, 0.0, 1.0));
      std::copy(colour.begin(), colour.end(), rgb.begin() + static_cast<std::ptrdiff_t>(3 * i));
    }
  }
  return to_image(rgb, picture.width, picture.height);
}

std::vector<float> surface_normals(const Picture& picture, const Camera& camera) {
  const std::vector<float> directions = pixel_directions(camera);
  const auto width = static_cast<std::size_t>(picture.width), height = static_cast<std::size_t>(picture.height);
  std::vector<float> normals(3 * width * height, 0.f);
  const auto point = [&](std::size_t pixel) -> Eigen::Vector3d {
    const Eigen::Vector3d way = Eigen::Map<const Eigen::Vector3f>(directions.data() + 3 * pixel).cast<double>();
    return way.normalized() * static_cast<double>(picture.depth[pixel]);
  };
  for (std::size_t y = 1; y + 1 < height; ++y)
    for (std::size_t x = 1; x + 1 < width; ++x) {
      const std::size_t i = y * width + x;
      const double here = static_cast<double>(picture.depth[i]);
      const auto near_by = [&](std::size_t j) {
        return is_surface(picture, j) && std::abs(static_cast<double>(picture.depth[j]) - here) < kEdge * here;
      };
      if (!is_surface(picture, i) || !near_by(i - 1) || !near_by(i + 1) || !near_by(i - width) || !near_by(i + width))
        continue;
      // x is right and y down, so this looks away from the camera on a wall before it.
      Eigen::Vector3d normal = (point(i + 1) - point(i - 1)).cross(point(i + width) - point(i - width)).normalized();
      if (normal.dot(point(i)) > 0) normal = -normal;
      for (std::size_t c = 0; c < 3; ++c) normals[3 * i + c] = static_cast<float>(normal[static_cast<Eigen::Index>(c)]);
    }
  return normals;
}

Image normal_picture(const Picture& picture, const Camera& camera) {
  std::vector<float> rgb = surface_normals(picture, camera);
  for (std::size_t i = 0; i < rgb.size(); i += 3) {
    if (rgb[i] == 0 && rgb[i + 1] == 0 && rgb[i + 2] == 0) continue;
    const float shown[] = {rgb[i], -rgb[i + 1], -rgb[i + 2]};
    for (std::size_t c = 0; c < 3; ++c) rgb[i + c] = 0.5f + 0.5f * shown[c];
  }
  return to_image(rgb, picture.width, picture.height);
}

Image opacity_picture(const Picture& picture) {
  std::vector<float> rgb;
  for (const float opacity : picture.opacity) rgb.insert(rgb.end(), 3, opacity);
  return to_image(rgb, picture.width, picture.height);
}

}  // namespace cloam
