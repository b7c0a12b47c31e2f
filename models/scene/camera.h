// A camera's intrinsics and lens. Axes x right, y down, z forward; pixel (column, row) has its centre at
// (column + 0.5, row + 0.5); lengths of the intrinsics are pixels.
#pragma once
#include <Eigen/Core>
#include <array>
#include <compare>
#include <vector>

namespace cloam {

// A lens takes a direction to a point of its plane, and there distorts. r is the distance of that point from the axis.
//   opencv   the point is (x, y) / z. Distortion: the gain (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) over
//            (1 + d1 r^2 + d2 r^4 + d3 r^6), tangential terms p1, p2, and a thin prism's s1 r^2, s2 r^2.
//   fisheye  r is the angle from the axis (Kannala-Brandt, as cv::fisheye); then the same distortion.
//   fov      r = atan(2 tan(w / 2) tan(angle)) / w, w = k1 in radians (Devernay and Faugeras 2001), and no distortion.
enum class CameraModel { pinhole, opencv, fisheye, fov };

struct Camera {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  CameraModel model = CameraModel::pinhole;
  std::array<double, 4> k = {0, 0, 0, 0};
  double p1 = 0, p2 = 0;
  std::array<double, 3> denominator = {0, 0, 0};  // d1, d2, d3; OpenCV and COLMAP call them k4, k5, k6
  std::array<double, 2> prism = {0, 0};           // s1, s2; COLMAP: sx1, sy1

  auto operator<=>(const Camera&) const = default;  // NOLINT(modernize-use-nullptr): no pointer is compared
};

/// The direction through each pixel centre in camera axes, lens undone: [height, width, 3]. z = 1 for pinhole and
/// opencv; unit length for fisheye and fov, which may look sideways and behind. Where a lens polynomial has no inverse
/// (outside the circle that it was fitted on) the nearest direction found is given; all values are finite.
std::vector<float> pixel_directions(const Camera& camera);

/// The direction through one image point (pixels), as pixel_directions.
Eigen::Vector3d direction(const Camera& camera, const Eigen::Vector2d& point);

/// Where a point in camera axes appears, in pixels. Its z must be positive except for fisheye and fov.
Eigen::Vector2d project(const Camera& camera, const Eigen::Vector3d& point_in_camera);

/// How a lens differs from the one given.
struct LensChange {
  double focal = 1;                 // both focal lengths over those given
  Eigen::Vector2d centre = {0, 0};  // shift of the principal point, in focal lengths given
};
/// The camera with that lens, its distortion in the same place of the picture: a point that is seen along (x, y, 1) is
/// then seen along ((x, y) - centre) / focal, 1. Of pinhole and opencv alone; shifts of pinholes alone.
Camera with_lens(const Camera& camera, const LensChange& change);

/// The camera of an image after downscale() of models/io/image.h by the same factor: floored size, lengths divided.
/// With centres at +0.5 a box of pixels keeps its centre, so no half-pixel shift is needed.
Camera scaled(const Camera& camera, int factor);

/// The camera of the same view sampled at another size; the lens is unchanged.
Camera resized(const Camera& camera, int width, int height);

}  // namespace cloam
