// See box_projection.h.
#include "models/scene/box_projection.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace cloam {
namespace {

constexpr double kNear = 0.1;        // metres
constexpr double kRounding = 1e-6;   // pixels: a bound on the edge of a pixel is not in the next one
constexpr double kSameRay = 1e-4;    // radians
constexpr int kPiecesOfCurves = 64;  // a lens bends the edges of a box

bool sees_sideways(const Camera& camera) {
  return camera.model == CameraModel::fisheye || camera.model == CameraModel::fov;
}

bool is_too_near(const Camera& camera, const Eigen::Vector3d& point) {
  const double distance = sees_sideways(camera) ? point.norm() : point.z();
  return distance < kNear * (1 - 1e-9);  // what was cut at kNear stays
}

struct Edge {
  Eigen::Vector3d from, to;
};

/// The twelve edges of a box, in camera axes.
std::vector<Edge> edges_of(const Eigen::Matrix4d& camera_from_box, const Eigen::Vector3d& size) {
  const auto corner = [&](int number) -> Eigen::Vector3d {
    const Eigen::Vector3d sides((number & 1) - 0.5, (number >> 1 & 1) - 0.5, (number >> 2 & 1) - 0.5);
    return (camera_from_box * sides.cwiseProduct(size).homogeneous()).head<3>();
  };
  std::vector<Edge> edges;
  for (int number = 0; number < 8; ++number)
    for (int axis = 0; axis < 3; ++axis)
      if ((number >> axis & 1) == 0) edges.push_back({corner(number), corner(number | 1 << axis)});
  return edges;
}

/// The part of an edge with z of kNear or more.
std::optional<Edge> cut_at_near(Edge edge) {
  if (edge.from.z() > edge.to.z()) std::swap(edge.from, edge.to);
  if (edge.to.z() < kNear) return std::nullopt;
  if (edge.from.z() >= kNear) return edge;
  const double share = (kNear - edge.from.z()) / (edge.to.z() - edge.from.z());
  edge.from += share * (edge.to - edge.from);
  edge.from.z() = kNear;
  return edge;
}

struct Bounds {
  Eigen::Vector2d least = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d most = -least;

  void add(const Eigen::Vector2d& pixel) {
    least = least.cwiseMin(pixel);
    most = most.cwiseMax(pixel);
  }
};

void add_edge(const Camera& camera, const Edge& edge, Bounds& bounds) {
  const int pieces = camera.model == CameraModel::pinhole ? 1 : kPiecesOfCurves;
  for (int i = 0; i <= pieces; ++i) {
    const double share = static_cast<double>(i) / pieces;
    if (const auto pixel = pixel_of(camera, (1 - share) * edge.from + share * edge.to)) bounds.add(*pixel);
  }
}

int first_pixel(double bound, int count) {
  return static_cast<int>(std::clamp(std::floor(bound + kRounding), 0.0, static_cast<double>(count)));
}

int end_of_pixels(double bound, int count) {
  return static_cast<int>(std::clamp(std::ceil(bound - kRounding), 0.0, static_cast<double>(count)));
}

/// The part of `other` that lies in `box`; of no width or height where there is none.
PixelBox common_part(const PixelBox& box, const PixelBox& other) {
  PixelBox part{std::max(box.left, other.left), std::max(box.top, other.top), 0, 0};
  part.right = std::max(part.left, std::min(box.right, other.right));
  part.bottom = std::max(part.top, std::min(box.bottom, other.bottom));
  return part;
}

/// How many rows the boxes that span columns left to right cover.
std::int64_t rows_covered(const std::vector<PixelBox>& by_top, int left, int right) {
  std::int64_t rows = 0;
  int end = std::numeric_limits<int>::min();
  for (const PixelBox& box : by_top) {
    if (box.left > left || box.right < right || box.bottom <= end) continue;
    rows += box.bottom - std::max(box.top, end);
    end = box.bottom;
  }
  return rows;
}

}  // namespace

std::optional<Eigen::Vector2d> pixel_of(const Camera& camera, const Eigen::Vector3d& point) {
  if (is_too_near(camera, point)) return std::nullopt;
  const Eigen::Vector2d pixel = project(camera, point);
  if (!pixel.allFinite()) return std::nullopt;
  if (camera.model == CameraModel::pinhole) return pixel;
  const Eigen::Vector3d ray = direction(camera, pixel).normalized();
  const bool folds = (ray - point.normalized()).norm() > kSameRay;
  return folds ? std::nullopt : std::optional(pixel);
}

std::optional<PixelBox> bounds_in_image(const Camera& camera, const Eigen::Matrix4d& camera_from_box,
                                        const Eigen::Vector3d& size) {
  const Eigen::Vector3d eye = camera_from_box.inverse().topRightCorner<3, 1>();
  if ((eye.cwiseAbs().array() <= 0.5 * size.array()).all()) return std::nullopt;
  Bounds bounds;
  for (const Edge& edge : edges_of(camera_from_box, size)) {
    const auto seen = sees_sideways(camera) ? std::optional(edge) : cut_at_near(edge);
    if (seen) add_edge(camera, *seen, bounds);
  }
  if (!bounds.least.allFinite()) return std::nullopt;
  const PixelBox box{first_pixel(bounds.least.x(), camera.width), first_pixel(bounds.least.y(), camera.height),
                     end_of_pixels(bounds.most.x(), camera.width), end_of_pixels(bounds.most.y(), camera.height)};
  if (box.width() <= 0 || box.height() <= 0) return std::nullopt;
  return box;
}

double covered_share(const PixelBox& box, const std::vector<PixelBox>& others) {
  std::vector<PixelBox> parts;
  std::vector<int> sides;
  for (const PixelBox& other : others) {
    const PixelBox part = common_part(box, other);
    if (part.area() == 0) continue;
    parts.push_back(part);
    sides.insert(sides.end(), {part.left, part.right});
  }
  std::sort(sides.begin(), sides.end());
  std::sort(parts.begin(), parts.end(), [](const PixelBox& a, const PixelBox& b) { return a.top < b.top; });
  std::int64_t covered = 0;
  for (std::size_t i = 0; i + 1 < sides.size(); ++i)
    if (sides[i] < sides[i + 1]) covered += (sides[i + 1] - sides[i]) * rows_covered(parts, sides[i], sides[i + 1]);
  return static_cast<double>(covered) / static_cast<double>(box.area());
}

}  // namespace cloam
