// See street_gaussians_renderer.h.
#include "models/methods/street_gaussians_renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>

#include "models/render/undistort.h"
#include "models/splat/sky_map.h"

namespace cloam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr float kCovered = 0.5f;  // opacity from which on there is something
constexpr int kFace = 1024;       // pixels of a face of 90 degrees that LiDAR's rays are looked up in
constexpr float kEdge = 1.1f;     // times as far as the nearest of four pixels: an edge lies between

/// What a pinhole shows of some gaussians on black, with how much of each pixel is of which actor.
struct Layers {
  std::vector<float> planes;   // [4,H,W]: red, green, blue, the sum of weights times z
  std::vector<float> through;  // [H,W]
  std::vector<int> actors;     // [H,W] as Picture::actors
};

/// Those that some tile lists, and that are actors.
std::vector<int> listed_actors(const Drawn& drawn, const std::vector<int>& actors) {
  const std::vector<int32_t> first = drawn.tiles.first.to_host<int32_t>();
  std::vector<int> found;
  for (size_t i = 0; i < actors.size(); ++i)
    if (actors[i] > 0 && first[i + 1] > first[i]) found.push_back(actors[i]);
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// The actor that most of a pixel's actors' light is of, where that is at least half of all.
std::vector<int> seen_actors(const StreetGaussiansModel::Shown& shown, const Drawn& drawn) {
  const std::vector<int> listed = listed_actors(drawn, shown.actors);
  const auto pixels = static_cast<size_t>(drawn.transmittance.numel());
  std::vector<float> most(pixels, 0), sums(pixels, 0);
  std::vector<int> out(pixels, 0);
  constexpr size_t kAtOnce = 3;  // channels of one pass
  for (size_t first = 0; first < listed.size(); first += kAtOnce) {
    const size_t count = std::min(kAtOnce, listed.size() - first);
    std::vector<float> own;
    for (const int actor : shown.actors)
      for (size_t k = 0; k < count; ++k) own.push_back(actor == listed[first + k] ? 1.f : 0.f);
    const Tensor channels = from_host(own, {static_cast<int64_t>(shown.actors.size()), static_cast<int64_t>(count)});
    const std::vector<float> covered = splat_blend({drawn.seen, channels}, drawn.tiles).image.to_host();
    for (size_t i = 0; i < covered.size(); ++i) {
      sums[i / count] += covered[i];
      if (covered[i] <= most[i / count]) continue;
      most[i / count] = covered[i];
      out[i / count] = listed[first + i % count];
    }
  }
  for (size_t i = 0; i < pixels; ++i)
    if (sums[i] < kCovered) out[i] = 0;
  return out;
}

Layers layers_of(const StreetGaussiansModel::Shown& shown, const Camera& camera) {
  DrawOptions options;
  options.depth = true;
  const Drawn drawn = draw(shown.projection, camera, options);
  Tensor planes = drawn.planes, through = drawn.transmittance;
  if (shown.ground) {
    const Drawn ground = draw(*shown.ground, camera, options);
    planes = planes + unsqueeze(through, 0) * ground.planes;
    through = through * ground.transmittance;
  }
  return {planes.to_host(), through.to_host(), seen_actors(shown, drawn)};
}

/// Depth along the ray of a pixel; 0 where little covers it.
std::vector<float> depths_of(const Layers& layers, const std::vector<float>& directions) {
  const size_t pixels = layers.through.size();
  std::vector<float> out;
  for (size_t i = 0; i < pixels; ++i) {
    const float opacity = 1 - layers.through[i], *d = &directions[3 * i];
    const float along = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    out.push_back(opacity >= kCovered ? layers.planes[3 * pixels + i] / opacity * along : 0.f);
  }
  return out;
}

Picture picture_from(const Layers& layers, const Camera& camera, const std::vector<float>& behind,
                     const std::array<float, 6>& exposure = {1, 1, 1, 0, 0, 0}) {
  const size_t pixels = layers.through.size();
  Picture out{camera.width, camera.height, {}, depths_of(layers, pixel_directions(camera)), {}, layers.actors};
  for (size_t i = 0; i < pixels; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const float light = layers.planes[c * pixels + i] + layers.through[i] * behind[3 * i + c];
      out.rgb.push_back(std::clamp(light * exposure[c] + exposure[3 + c], 0.f, 1.f));
    }
    out.opacity.push_back(1 - layers.through[i]);
  }
  return out;
}

/// Axes of a pinhole that looks along an axis of the world, to either side.
Matrix3d face_axes(int axis, bool negative) {
  Matrix3d axes;
  const Vector3d ahead = (negative ? -1 : 1) * Vector3d::Unit(axis), down = Vector3d::Unit((axis + 1) % 3);
  axes << down.cross(ahead), down, ahead;
  return axes;
}

/// Rays that begin in one place at one time and lie in one face: numbers of rays.
using FaceKey = std::tuple<std::array<float, 3>, double, int>;

struct PartOfFace {
  Camera camera;  // only the pixels that its rays need
  Eigen::Matrix4d world_from_camera = Eigen::Matrix4d::Identity();
};

Vector3d of_ray(const std::vector<float>& values, size_t ray) {
  return Eigen::Map<const Eigen::Vector3f>(&values[3 * ray]).cast<double>();
}

PartOfFace part_for(const WorldRays& rays, const std::vector<size_t>& which, int face) {
  PartOfFace out;
  out.world_from_camera.topLeftCorner<3, 3>() = face_axes(face / 2, face % 2 == 1);
  out.world_from_camera.topRightCorner<3, 1>() = of_ray(rays.origins, which.front());
  Camera whole;
  whole.width = whole.height = kFace;
  whole.fx = whole.fy = whole.cx = whole.cy = kFace / 2.0;
  Eigen::Vector2d low(kFace, kFace), high(0, 0);
  for (const size_t ray : which) {
    const Vector3d d = out.world_from_camera.topLeftCorner<3, 3>().transpose() * of_ray(rays.directions, ray);
    const Eigen::Vector2d at = project(whole, d);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  low = (low.array() - 1.5).floor();
  high = (high.array() + 1.5).ceil();
  out.camera = whole;
  out.camera.cx -= low.x();
  out.camera.cy -= low.y();
  out.camera.width = static_cast<int>(high.x() - low.x());
  out.camera.height = static_cast<int>(high.y() - low.y());
  return out;
}

/// z at a place of a depth picture (0: nothing).
float read_between(const std::vector<float>& depths, const Camera& camera, const Eigen::Vector2d& at) {
  const int x = std::clamp(static_cast<int>(std::floor(at.x() - 0.5)), 0, camera.width - 2),
            y = std::clamp(static_cast<int>(std::floor(at.y() - 0.5)), 0, camera.height - 2);
  const double across = std::clamp(at.x() - 0.5 - x, 0.0, 1.0), down = std::clamp(at.y() - 0.5 - y, 0.0, 1.0);
  const auto depth = [&](int column, int row) {
    return depths[static_cast<size_t>(row) * static_cast<size_t>(camera.width) + static_cast<size_t>(column)];
  };
  const std::array<float, 4> four = {depth(x, y), depth(x + 1, y), depth(x, y + 1), depth(x + 1, y + 1)};
  const auto [least, most] = std::minmax_element(four.begin(), four.end());
  if (*least <= 0 || *most > kEdge * *least) return depth(x + (across >= 0.5), y + (down >= 0.5));
  const double inverse = (1 - down) * ((1 - across) / double{four[0]} + across / double{four[1]}) +
                         down * ((1 - across) / double{four[2]} + across / double{four[3]});
  return static_cast<float>(1 / inverse);
}

}  // namespace

Picture picture_of(const StreetGaussiansModel& model, const View& view) {
  View straight = view;
  straight.camera = pinhole_around(view.camera);
  const Layers layers = layers_of(model.shown(straight), straight.camera);
  const std::vector<float> sky = transpose(model.sky(directions_of(straight.camera), view.world_from_camera)).to_host();
  return resample(picture_from(layers, straight.camera, sky, model.exposure_of(view.sensor)),
                  pixel_map(view.camera, straight.camera));
}

Picture asset_picture(const StreetGaussiansModel& model, std::size_t actor, const Camera& camera,
                      const Eigen::Matrix4d& box_from_camera) {
  const Camera pinhole = pinhole_around(camera);
  const size_t pixels = static_cast<size_t>(pinhole.width) * static_cast<size_t>(pinhole.height);
  const StreetGaussiansModel::Shown shown = model.alone(actor, pinhole, box_from_camera);
  const Layers layers = shown.actors.empty() ? Layers{std::vector<float>(4 * pixels, 0), std::vector<float>(pixels, 1),
                                                      std::vector<int>(pixels, 0)}
                                             : layers_of(shown, pinhole);
  return resample(picture_from(layers, pinhole, std::vector<float>(3 * pixels, 1)), pixel_map(camera, pinhole));
}

LidarReturns returns_of(const StreetGaussiansModel& model, const WorldRays& rays) {
  const size_t count = rays.directions.size() / 3;
  LidarReturns out{std::vector<float>(count, 0), std::vector<int>(count, 0)};
  std::map<FaceKey, std::vector<size_t>> faces;
  for (size_t ray = 0; ray < count; ++ray) {
    const float* o = &rays.origins[3 * ray];
    const Vector3d d = of_ray(rays.directions, ray);
    int axis = 0;
    d.cwiseAbs().maxCoeff(&axis);
    const double time = rays.times.empty() ? rays.time : rays.times[ray];
    faces[{{o[0], o[1], o[2]}, time, 2 * axis + (d[axis] < 0)}].push_back(ray);
  }
  for (const auto& [key, which] : faces) {
    const PartOfFace part = part_for(rays, which, std::get<int>(key));
    const Layers layers =
        layers_of(model.shown({part.camera, part.world_from_camera, rays.scene, std::get<double>(key)}), part.camera);
    const size_t pixels = layers.through.size();
    std::vector<float> z;
    for (size_t i = 0; i < pixels; ++i) {
      const float opacity = 1 - layers.through[i];
      z.push_back(opacity >= kCovered ? layers.planes[3 * pixels + i] / opacity : 0.f);
    }
    for (const size_t ray : which) {
      const Vector3d d = part.world_from_camera.topLeftCorner<3, 3>().transpose() * of_ray(rays.directions, ray);
      const Eigen::Vector2d at = project(part.camera, d);
      out.depths[ray] = read_between(z, part.camera, at) / static_cast<float>(d.z() / d.norm());
      const auto nearest =
          static_cast<size_t>(at.y()) * static_cast<size_t>(part.camera.width) + static_cast<size_t>(at.x());
      if (out.depths[ray] > 0) out.actors[ray] = layers.actors[nearest];
    }
  }
  return out;
}

}  // namespace cloam
