// A camera's intrinsics and lens. Axes x right, y down, z forward; pixel (column, row) has its centre at
// (column + 0.5, row + 0.5); lengths of the intrinsics are pixels.
#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

namespace cloam {

// opencv: radial polynomial 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8 with tangential p1, p2.
// fisheye: Kannala-Brandt, theta (1 + k1 theta^2 + ... + k4 theta^8), as cv::fisheye.
enum class CameraModel { pinhole, opencv, fisheye };

struct Camera {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  CameraModel model = CameraModel::pinhole;
  std::array<double, 4> k = {0, 0, 0, 0};
  double p1 = 0, p2 = 0;

  bool operator==(const Camera&) const = default;
};

/// The direction through each pixel centre in camera axes, lens undone: [height, width, 3]. z = 1 for pinhole and
/// opencv; unit length for fisheye, which may look sideways and behind. Where a lens polynomial has no inverse
/// (outside the circle that it was fitted on) the nearest direction found is given; all values are finite.
std::vector<float> pixel_directions(const Camera& camera);

/// The direction through one image point (pixels), as pixel_directions.
Eigen::Vector3d direction(const Camera& camera, const Eigen::Vector2d& point);

/// Where a point in camera axes appears, in pixels. Its z must be positive except for fisheye.
Eigen::Vector2d project(const Camera& camera, const Eigen::Vector3d& point_in_camera);

/// The camera of an image after downscale() of models/io/image.h by the same factor: floored size, lengths divided.
/// With centres at +0.5 a box of pixels keeps its centre, so no half-pixel shift is needed.
Camera scaled(const Camera& camera, int factor);

/// The camera of the same view sampled at another size; the lens is unchanged.
Camera resized(const Camera& camera, int width, int height);

}  // namespace cloam
