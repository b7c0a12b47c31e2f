// See seen_points.h.
#include "models/eval/seen_points.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "models/eval/geometry_pictures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kFewestPixels = 1 << 11;  // in a picture: in small ones, neighbours are no one surface's

/// The camera with at most so many pixels.
Camera camera_of(const Camera& camera, std::size_t pixels) {
  const double shrink =
      std::min(1.0, std::sqrt(static_cast<double>(pixels) / (static_cast<double>(camera.width) * camera.height)));
  const auto side = [&](int length) { return std::max(3, static_cast<int>(shrink * length)); };
  return resized(camera, side(camera.width), side(camera.height));
}

void append(std::vector<float>& values, const Eigen::Vector3d& more) {
  for (const double value : more) values.push_back(static_cast<float>(value));
}

void append(Mesh& points, const Mesh& more) {
  points.positions.insert(points.positions.end(), more.positions.begin(), more.positions.end());
  points.normals.insert(points.normals.end(), more.normals.begin(), more.normals.end());
  points.colours.insert(points.colours.end(), more.colours.begin(), more.colours.end());
}

void add_points(Mesh& points, const Picture& picture, const View& view, double farthest) {
  const std::vector<float> directions = pixel_directions(view.camera), normals = surface_normals(picture, view.camera);
  const Eigen::Matrix3d turn = view.world_from_camera.topLeftCorner<3, 3>();
  const Eigen::Vector3d eye = view.world_from_camera.topRightCorner<3, 1>();
  for (std::size_t i = 0; i < picture.depth.size(); ++i) {
    const Eigen::Vector3d normal = Eigen::Map<const Eigen::Vector3f>(&normals[3 * i]).cast<double>();
    const double depth = static_cast<double>(picture.depth[i]);
    if (normal.isZero() || depth > farthest || (!picture.actors.empty() && picture.actors[i] != 0)) continue;
    const Eigen::Vector3d way = Eigen::Map<const Eigen::Vector3f>(&directions[3 * i]).cast<double>().normalized();
    append(points.positions, eye + turn * way * depth);
    append(points.normals, turn * normal);
    points.colours.insert(points.colours.end(), &picture.rgb[3 * i], &picture.rgb[3 * i] + 3);
  }
}

/// Every so many of them, so that at most `most` are left.
void thin(Mesh& points, std::size_t most) {
  const std::size_t count = points.positions.size() / 3;
  if (count <= most) return;
  for (std::vector<float>* values : {&points.positions, &points.normals, &points.colours}) {
    for (std::size_t i = 0; i < most; ++i)
      std::copy_n(values->begin() + static_cast<std::ptrdiff_t>(3 * (i * count / most)), 3,
                  values->begin() + static_cast<std::ptrdiff_t>(3 * i));
    values->resize(3 * most);
  }
}

}  // namespace

Mesh seen_points(RendersViews& method, const Scene& scene, int index, const SeenPointsWish& wish,
                 const Listener& listener) {
  const std::vector<std::size_t> frames = frames_of(scene, Split::train);
  Mesh points;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    listener.check_stop([] { return std::string("no file was written"); });
    const Frame& frame = scene.frames[frames[i]];
    const std::size_t pixels = std::max(wish.most / frames.size(), kFewestPixels);
    const View view = view_of(frame, camera_of(scene.cameras[static_cast<std::size_t>(frame.camera)], pixels), index);
    Mesh seen;
    add_points(seen, method.render(view), view, wish.farthest);
    thin(seen, std::max<std::size_t>(1, wish.most / frames.size()));
    append(points, seen);
    listener.say(text("points ", i + 1, "/", frames.size(), "  ", frame.name));
  }
  thin(points, wish.most);
  return points;
}

}  // namespace cloam
