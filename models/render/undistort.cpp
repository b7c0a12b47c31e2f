// See undistort.h.
#include "models/render/undistort.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace cloam {
namespace {

constexpr double kMaxPixels = 4;      // times those of the lens
constexpr double kSamePlace = 0.01;   // pixels: a lens polynomial that folds back leads elsewhere
constexpr double kShareStep = 1e-5;   // of a rectangle that is looked for
constexpr double kMinForward = 1e-6;  // of a direction of length 1

/// Tangents of the angles that are seen, right and down.
struct Extent {
  double left = std::numeric_limits<double>::infinity(), right = -left, top = left, bottom = -left;

  /// What lies further out than a pinhole looks counts where the way to it leaves the pinhole's image.
  void add(double x, double y) {
    const double furthest = std::max(std::abs(x), std::abs(y)), widest = std::tan(kWidestPinhole);
    const double cut = furthest > widest ? widest / furthest : 1;
    left = std::min(left, cut * x);
    right = std::max(right, cut * x);
    top = std::min(top, cut * y);
    bottom = std::max(bottom, cut * y);
  }
  Extent times(double share) const { return {share * left, share * right, share * top, share * bottom}; }
};

bool looks_ahead(const Camera& camera, const Eigen::Vector3d& direction) {
  const bool any_side = camera.model == CameraModel::fisheye || camera.model == CameraModel::fov;
  return any_side || direction.z() > kMinForward * direction.norm();
}

/// Where a camera sees a direction; none outside its image, and where its lens has no inverse.
std::optional<Eigen::Vector2d> place_of(const Camera& camera, const Eigen::Vector3d& towards) {
  if (!looks_ahead(camera, towards)) return std::nullopt;
  const Eigen::Vector2d at = project(camera, towards);
  const bool inside = at.x() >= 0 && at.y() >= 0 && at.x() <= camera.width && at.y() <= camera.height;
  if (!inside) return std::nullopt;
  if (camera.model == CameraModel::pinhole) return at;
  const Eigen::Vector3d back = direction(camera, at).normalized();
  const double off = (back - towards.normalized()).norm() * std::max(camera.fx, camera.fy);
  return off < kSamePlace ? std::optional(at) : std::nullopt;
}

Extent extent_of(const Camera& lens) {
  Extent extent;
  const auto add = [&](double x, double y) {
    const Eigen::Vector3d towards = direction(lens, {x, y});
    const bool sound = (project(lens, towards) - Eigen::Vector2d(x, y)).norm() < kSamePlace;
    if (!sound || !towards.allFinite()) return;
    const double side = towards.head<2>().norm();
    if (side == 0) return extent.add(0, 0);
    // Beyond a right angle there is no tangent: as far out as can be.
    const double tangent = looks_ahead({}, towards) ? side / towards.z() : 1 / kMinForward;
    extent.add(towards.x() / side * tangent, towards.y() / side * tangent);
  };
  // The rim decides, and the inside where the lens has no inverse at the rim.
  const double right = lens.width, bottom = lens.height;
  for (int x = 0; x <= lens.width; ++x) {
    add(x, 0);
    add(x, bottom);
  }
  for (int y = 0; y <= lens.height; ++y) {
    add(0, y);
    add(right, y);
  }
  constexpr int kInside = 64;
  for (int i = 1; i < kInside; ++i) {
    for (int j = 1; j < kInside; ++j) add(right * i / kInside, bottom * j / kInside);
  }
  return extent;
}

/// Pixels a unit of tangent at the lens's middle.
double scale_at_middle(const Camera& lens) {
  return lens.model == CameraModel::fov ? 2 * std::tan(lens.k[0] / 2) / lens.k[0] : 1;
}

/// Whether the lens sees all of the rectangle's rim, and so its inside: what a lens sees has no holes.
bool sees_rim(const Camera& lens, const Extent& extent) {
  constexpr int kPlaces = 64;  // of a side
  const auto is_seen = [&](double x, double y) { return place_of(lens, {x, y, 1}).has_value(); };
  for (int i = 0; i <= kPlaces; ++i) {
    const double x = std::lerp(extent.left, extent.right, double(i) / kPlaces),
                 y = std::lerp(extent.top, extent.bottom, double(i) / kPlaces);
    if (!is_seen(x, extent.top) || !is_seen(x, extent.bottom) || !is_seen(extent.left, y) || !is_seen(extent.right, y))
      return false;
  }
  return true;
}

/// Its image is the rectangle, as fine as the lens at its middle or as kMaxPixels allows; `whole` rounds its sides.
template <class Whole>
Camera pinhole_of(const Camera& lens, const Extent& extent, const Whole& whole) {
  Camera pinhole;
  pinhole.fx = lens.fx * scale_at_middle(lens);
  pinhole.fy = lens.fy * scale_at_middle(lens);
  const double across = extent.right - extent.left, down = extent.bottom - extent.top;
  if (!(across > 0 && down > 0)) {  // no inverse anywhere: nothing that could be covered
    pinhole.width = lens.width;
    pinhole.height = lens.height;
    pinhole.cx = lens.cx;
    pinhole.cy = lens.cy;
    return pinhole;
  }
  const double wanted = pinhole.fx * across * pinhole.fy * down;
  const double shrink = std::min(1.0, std::sqrt(kMaxPixels * lens.width * lens.height / wanted));
  pinhole.fx *= shrink;
  pinhole.fy *= shrink;
  pinhole.width = std::max(1, static_cast<int>(whole(pinhole.fx * across)));
  pinhole.height = std::max(1, static_cast<int>(whole(pinhole.fy * down)));
  pinhole.cx = -pinhole.fx * extent.left;
  pinhole.cy = -pinhole.fy * extent.top;
  return pinhole;
}

/// The four pixels around a place and their weights; at the rim a pixel stands for those that are missing.
struct Taps {
  std::array<std::size_t, 4> pixel;
  std::array<float, 4> weight;
};

Taps taps_at(float x, float y, int width, int height) {
  const auto axis = [](float at, int size, std::array<int, 2>& cells) {
    const float from = std::clamp(at - 0.5f, 0.f, static_cast<float>(size - 1));
    cells[0] = static_cast<int>(from);
    cells[1] = std::min(cells[0] + 1, size - 1);
    return from - static_cast<float>(cells[0]);
  };
  std::array<int, 2> columns{}, rows{};
  const float across = axis(x, width, columns), down = axis(y, height, rows);
  Taps taps{};
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t column = i % 2, row = i / 2;
    taps.pixel[i] = std::size_t(rows[row]) * width + columns[column];
    taps.weight[i] = (column ? across : 1 - across) * (row ? down : 1 - down);
  }
  return taps;
}

std::size_t nearest(const Taps& taps) {
  const auto most = std::max_element(taps.weight.begin(), taps.weight.end()) - taps.weight.begin();
  return taps.pixel[static_cast<std::size_t>(most)];
}

std::size_t pixels_of(const PixelMap& map) { return std::size_t(map.width) * map.height; }
bool is_seen(const PixelMap& map, std::size_t pixel) { return !std::isnan(map.points[2 * pixel]); }

/// use(pixel, taps) for the pixels that see something of `from`, an image of that size.
template <class From, class Use>
void for_each_seen(const PixelMap& map, const From& from, const Use& use) {
  for (std::size_t pixel = 0; pixel < pixels_of(map); ++pixel)
    if (is_seen(map, pixel))
      use(pixel, taps_at(map.points[2 * pixel], map.points[2 * pixel + 1], from.width, from.height));
}

void blend_rgba(const std::vector<std::uint8_t>& rgba, const Taps& taps, std::uint8_t* result) {
  float sums[4] = {}, alpha = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::uint8_t* pixel = &rgba[4 * taps.pixel[i]];
    const float weight = taps.weight[i] * pixel[3];
    for (int c = 0; c < 3; ++c) sums[c] += weight * pixel[c];
    alpha += weight;
  }
  for (int c = 0; c < 3; ++c)
    result[c] = static_cast<std::uint8_t>(std::min(255L, alpha > 0 ? std::lround(sums[c] / alpha) : 0));
  result[3] = static_cast<std::uint8_t>(std::min(255L, std::lround(alpha)));
}

/// Values [H,W,channels] of a picture.
std::vector<float> blend(const std::vector<float>& values, const Picture& picture, const PixelMap& map, int channels) {
  if (values.empty()) return {};
  std::vector<float> result(pixels_of(map) * channels, 0.f);
  for_each_seen(map, picture, [&](std::size_t pixel, const Taps& taps) {
    for (std::size_t i = 0; i < 4; ++i)
      for (int c = 0; c < channels; ++c)
        result[pixel * channels + c] += taps.weight[i] * values[taps.pixel[i] * channels + c];
  });
  return result;
}

std::vector<float> blend_depth(const Picture& picture, const PixelMap& map) {
  if (picture.depth.empty()) return {};
  std::vector<float> result(pixels_of(map), 0.f);
  for_each_seen(map, picture, [&](std::size_t pixel, const Taps& taps) {
    float sum = 0, weights = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const float depth = picture.depth[taps.pixel[i]];
      sum += taps.weight[i] * depth;
      weights += depth > 0 ? taps.weight[i] : 0;
    }
    result[pixel] = weights > 0 ? sum / weights : 0;
  });
  return result;
}

std::vector<int> nearest_actors(const Picture& picture, const PixelMap& map) {
  if (picture.actors.empty()) return {};
  std::vector<int> result(pixels_of(map), 0);
  for_each_seen(map, picture,
                [&](std::size_t pixel, const Taps& taps) { result[pixel] = picture.actors[nearest(taps)]; });
  return result;
}

}  // namespace

Camera pinhole_around(const Camera& lens) {
  if (lens.model == CameraModel::pinhole) return lens;
  const Extent extent = extent_of(lens);
  return pinhole_of(lens, extent, [](double pixels) { return std::ceil(pixels - kSamePlace); });
}

Camera pinhole_within(const Camera& lens) {
  if (lens.model == CameraModel::pinhole) return lens;
  const Extent around = extent_of(lens);
  double inside = 0, beyond = 1;  // shares of `around`
  while (beyond - inside > kShareStep) {
    const double share = (inside + beyond) / 2;
    (sees_rim(lens, around.times(share)) ? inside : beyond) = share;
  }
  return pinhole_of(lens, around.times(inside), [](double pixels) { return std::floor(pixels); });
}

PixelMap pixel_map(const Camera& to, const Camera& from) {
  PixelMap map{to.width, to.height, to == from, {}};
  if (map.same) return map;
  const float nowhere = std::numeric_limits<float>::quiet_NaN();
  map.points.reserve(2 * pixels_of(map));
  for (int row = 0; row < to.height; ++row) {
    for (int column = 0; column < to.width; ++column) {
      const auto at = place_of(from, direction(to, {column + 0.5, row + 0.5}));
      map.points.push_back(at ? static_cast<float>(at->x()) : nowhere);
      map.points.push_back(at ? static_cast<float>(at->y()) : nowhere);
    }
  }
  return map;
}

std::vector<std::uint8_t> seen(const PixelMap& map) {
  if (map.same) return {};
  std::vector<std::uint8_t> result(pixels_of(map));
  for (std::size_t pixel = 0; pixel < result.size(); ++pixel) result[pixel] = is_seen(map, pixel) ? 255 : 0;
  const bool all = std::find(result.begin(), result.end(), 0) == result.end();
  return all ? std::vector<std::uint8_t>() : result;
}

FramePixels resample(const FramePixels& photo, const PixelMap& map) {
  if (map.same) return photo;
  FramePixels result{photo.frame, photo.camera, map.width, map.height, {}, seen(map)};
  if (!photo.mask.empty()) result.mask.resize(pixels_of(map), 255);
  if (!photo.depth.empty()) result.depth.resize(pixels_of(map));
  result.rgba.resize(4 * pixels_of(map));
  for_each_seen(map, photo, [&](std::size_t pixel, const Taps& taps) {
    blend_rgba(photo.rgba, taps, &result.rgba[4 * pixel]);
    if (!photo.depth.empty()) result.depth[pixel] = photo.depth[nearest(taps)];
    for (std::size_t i = 0; i < 4 && !photo.mask.empty(); ++i)
      if (taps.weight[i] > 0 && photo.mask[taps.pixel[i]] == 0) result.mask[pixel] = 0;
  });
  return result;
}

Pixels undistorted(const Pixels& photos) {
  Pixels result{{}, {}, photos.has_alpha, photos.warnings};
  std::vector<PixelMap> maps;
  for (const Camera& lens : photos.cameras) {
    result.cameras.push_back(pinhole_around(lens));
    maps.push_back(pixel_map(result.cameras.back(), lens));
  }
  for (const FramePixels& photo : photos.frames)
    result.frames.push_back(resample(photo, maps[static_cast<std::size_t>(photo.camera)]));
  return result;
}

Picture resample(const Picture& picture, const PixelMap& map) {
  if (map.same) return picture;
  return {map.width,
          map.height,
          blend(picture.rgb, picture, map, 3),
          blend_depth(picture, map),
          blend(picture.opacity, picture, map, 1),
          nearest_actors(picture, map)};
}

}  // namespace cloam
