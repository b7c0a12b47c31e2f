// Where boxes and points of the world appear in an image, in whole pixels.
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "models/scene/camera.h"

namespace cloam {

/// Columns from left to right - 1, rows from top to bottom - 1.
struct PixelBox {
  int left = 0, top = 0, right = 0, bottom = 0;

  int width() const { return right - left; }
  int height() const { return bottom - top; }
  std::int64_t area() const { return std::int64_t{width()} * height(); }
  bool operator==(const PixelBox&) const = default;
};

/// Where a point in camera axes appears, which may be outside of the image. None where it does not: nearer than 0.1 m
/// to the plane of the lens (fisheye and fov: to the camera), and so far from the axis that the lens model folds back.
std::optional<Eigen::Vector2d> pixel_of(const Camera& camera, const Eigen::Vector3d& point);

/// The pixels of the image that the projection of a box of this size about its origin spans. What is nearer than
/// 0.1 m is cut off. None for a box that is out of the image and for one that the camera is in.
std::optional<PixelBox> bounds_in_image(const Camera& camera, const Eigen::Matrix4d& camera_from_box,
                                        const Eigen::Vector3d& size);

/// How much of a box the others cover together, from 0 to 1.
double covered_share(const PixelBox& box, const std::vector<PixelBox>& others);

}  // namespace cloam
