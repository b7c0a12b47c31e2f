// See street_views.h.
#include "models/street/street_views.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int64_t kRaysAtOnce = 4096;  // rays

/// All blocks side by side, on the host.
struct Everything {
  std::vector<float> features, light, depth, opacity, actor_opacity, intensity, drop;
  std::vector<int> actors;
};

void append(std::vector<float>& to, const Tensor& from) {
  const std::vector<float> values = from.to_host();
  to.insert(to.end(), values.begin(), values.end());
}

Everything look(
    const StreetPainter& painter, const RayList& rays, const std::function<void()>& between = [] {}) {
  Everything all;
  for (int64_t begin = 0; begin < rays.count(); begin += kRaysAtOnce) {
    if (begin > 0) between();
    const int64_t end = std::min(rays.count(), begin + kRaysAtOnce);
    const SeenByRays seen = painter.look(part_of(rays, begin, end));
    append(all.features, seen.features);
    append(all.light, seen.light ? seen.light : ones({end - begin, 3}));
    append(all.depth, seen.depth);
    append(all.opacity, seen.opacity);
    append(all.actor_opacity, seen.actor_opacity);
    if (seen.intensity) append(all.intensity, seen.intensity);
    if (seen.drop) append(all.drop, seen.drop);
    for (const int32_t owner : seen.owners) all.actors.push_back(owner + 1);
  }
  for (size_t i = 0; i < all.depth.size(); ++i)
    if (all.opacity[i] < 0.5f) all.depth[i] = 0;
  return all;
}

/// Every value of a map for the scale x scale pixels that it stands for, cut to the picture.
template <class T>
std::vector<T> spread(const std::vector<T>& map, int scale, const Camera& size) {
  const int64_t columns = cells_of(size, scale).columns;
  std::vector<T> out;
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) out.push_back(map[static_cast<size_t>(y / scale * columns + x / scale)]);
  return out;
}

/// The actor that each pixel shows: where the opacity of actors, between rays bilinearly, is a half or more, the one
/// that most of it is of. A ray stands for several pixels, and outlines are finer than that.
std::vector<int> outlined(const Everything& all, int scale, const Region& cells, const Camera& size) {
  if (scale == 1) return all.actors;
  std::vector<int> out;
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) {
      const float column = std::max(0.f, (static_cast<float>(x) + 0.5f) / static_cast<float>(scale) - 0.5f),
                  row = std::max(0.f, (static_cast<float>(y) + 0.5f) / static_cast<float>(scale) - 0.5f);
      float covered = 0;
      std::map<int, float> of_actors;
      for (int corner = 0; corner < 4; ++corner) {
        const int64_t i = static_cast<int64_t>(column) + (corner & 1), j = static_cast<int64_t>(row) + (corner >> 1);
        const float weight = std::max(0.f, 1 - std::abs(column - static_cast<float>(i))) *
                             std::max(0.f, 1 - std::abs(row - static_cast<float>(j)));
        const auto at =
            static_cast<size_t>(std::min(j, cells.rows - 1) * cells.columns + std::min(i, cells.columns - 1));
        covered += weight * all.actor_opacity[at];
        if (all.actors[at] > 0) of_actors[all.actors[at]] += weight * all.actor_opacity[at];
      }
      const auto most = std::max_element(of_actors.begin(), of_actors.end(),
                                         [](const auto& a, const auto& b) { return a.second < b.second; });
      out.push_back(covered >= 0.5f && most != of_actors.end() ? most->first : 0);
    }
  return out;
}

/// Rays by rows and columns to [1,C,rows,columns].
Tensor map_of(const std::vector<float>& values, const Region& cells) {
  const int64_t channels = static_cast<int64_t>(values.size()) / (cells.rows * cells.columns);
  return permute(from_host(values, {1, cells.rows, cells.columns, channels}), {0, 3, 1, 2});
}

/// [1,C,h,w], cut to the picture, as [H,W,C].
std::vector<float> pixels_of(const Tensor& image, const Camera& size) {
  const Tensor cut = slice(slice(image, 2, 0, size.height), 3, 0, size.width);
  return permute(reshape(cut, {image.dim(1), size.height, size.width}), {1, 2, 0}).to_host();
}

}  // namespace

Picture street_picture(const StreetPainter& painter, const View& view, const StreetSpace& space,
                       const CameraMotion& motion) {
  const Camera& size = view.camera;
  const Region cells = cells_of(size, painter.scale);
  RayList rays;
  add_cells(rays, {size, space.street_from_world() * view.world_from_camera, view.time, motion}, cells, painter.scale);
  const Everything all = look(painter, rays, view.between);
  const auto map = [&](const std::vector<float>& values) { return map_of(values, cells); };
  Picture out{size.width, size.height, {}, {}, {}, {}};
  out.rgb = pixels_of(painter.image(map(all.features), map(all.light)), size);
  out.depth = spread(all.depth, painter.scale, size);
  out.opacity = spread(all.opacity, painter.scale, size);
  out.actors = outlined(all, painter.scale, cells, size);
  return out;
}

LidarReturns street_returns(const StreetPainter& painter, const WorldRays& rays, const StreetSpace& space) {
  const Eigen::Matrix4d& street_from_world = space.street_from_world();
  RayList list;
  list.times.push_back(rays.time);
  for (size_t i = 0; i + 3 <= rays.origins.size(); i += 3) {
    const Eigen::Vector3d origin = Eigen::Map<const Eigen::Vector3f>(&rays.origins[i]).cast<double>(),
                          direction = Eigen::Map<const Eigen::Vector3f>(&rays.directions[i]).cast<double>();
    list.add((street_from_world * origin.homogeneous()).head<3>(), street_from_world.topLeftCorner<3, 3>() * direction);
    if (!rays.times.empty()) list.last_is_at(rays.times[i / 3], 0);
  }
  Everything all = look(painter, list);
  return {std::move(all.depth), std::move(all.actors), std::move(all.intensity), std::move(all.drop)};
}

Picture asset_picture(const StreetPainter& painter, const Camera& camera, const Eigen::Matrix4d& box_from_camera) {
  const Region cells = cells_of(camera, painter.scale);
  RayList rays;
  add_cells(rays, {camera, box_from_camera, 0}, cells, painter.scale);
  const Everything all = look(painter, rays);
  const Tensor image = painter.image(map_of(all.features, cells), Tensor());
  const Tensor covered = resize_bilinear(map_of(all.actor_opacity, cells), image.dim(2), image.dim(3));
  Picture out{camera.width, camera.height, {}, {}, {}, {}};
  out.rgb = pixels_of(image * covered + (1.f - covered), camera);
  out.opacity = pixels_of(covered, camera);
  return out;
}

}  // namespace cloam
