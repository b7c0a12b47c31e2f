// GenAssets seen: pictures, LiDAR, and assets alone.
#include <Eigen/Geometry>
#include <algorithm>

#include "models/methods/genassets.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"
#include "runtime/ops/fields.h"
#include "runtime/ops/street.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr int64_t kRenderRays = 4096;
constexpr float kNormalStep = 0.01f;  // metres

Tensor dense_zeros(int64_t count) { return from_host(std::vector<int32_t>(static_cast<size_t>(count), 0), {count}); }

template <class T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

/// Every value of a map [h,w] for the scale x scale pixels that it stands for, cut to the picture.
template <class T>
std::vector<T> spread(const std::vector<T>& map, int64_t columns, int scale, int width, int height) {
  std::vector<T> out;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) out.push_back(map[static_cast<size_t>((y / scale) * columns + x / scale)]);
  return out;
}

}  // namespace

Picture GenAssets::render(const View& view) {
  const Log& log = logs_.at(static_cast<size_t>(view.scene));
  const int scale = image_->scale();
  RayList rays;
  add_view(rays, view, *log.space, scale);
  const int64_t columns = (view.camera.width + scale - 1) / scale, rows = rays.count() / columns,
                wide = config_.field.features;
  std::vector<float> features, shadow, depth, opacity;
  std::vector<int> actors;
  for (int64_t begin = 0; begin < rays.count();) {
    const int64_t end = std::min(rays.count(), begin + kRenderRays);
    const Shaded seen = shade(street(log, rays), part_of(rays, begin, end), {}, true);
    const Tensor light = seen.shadow ? seen.shadow : ones({end - begin, 3});
    eval({seen.features, seen.depth, seen.opacity, seen.alpha, light});
    append(features, seen.features.to_host());
    append(shadow, light.to_host());
    append(depth, seen.depth.to_host());
    append(opacity, seen.opacity.to_host());
    for (const int32_t owner : street_owners(seen.alpha, seen.samples).to_host<int32_t>()) actors.push_back(owner + 1);
    begin = end;
  }
  const auto map = [&](const std::vector<float>& x, int64_t channels) {
    return permute(from_host(x, {1, rows, columns, channels}), {0, 3, 1, 2});
  };
  const Tensor image =
      slice(slice(image_of(map(features, wide), map(shadow, 3)), 2, 0, view.camera.height), 3, 0, view.camera.width);
  Picture out;
  out.width = view.camera.width;
  out.height = view.camera.height;
  out.rgb = permute(reshape(image, {3, out.height, out.width}), {1, 2, 0}).to_host();
  for (size_t i = 0; i < depth.size(); ++i)
    if (opacity[i] < 0.5f) depth[i] = 0;
  out.depth = spread(depth, columns, scale, out.width, out.height);
  out.opacity = spread(opacity, columns, scale, out.width, out.height);
  out.actors = spread(actors, columns, scale, out.width, out.height);
  return out;
}

LidarReturns GenAssets::measure(const WorldRays& rays) {
  const Log& log = logs_.at(static_cast<size_t>(rays.scene));
  const Eigen::Matrix4d& street_from_world = log.space->street_from_world();
  RayList list;
  list.times.push_back(rays.time);
  const size_t count = rays.origins.size() / 3;
  for (size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d o(rays.origins[3 * i], rays.origins[3 * i + 1], rays.origins[3 * i + 2]),
        d(rays.directions[3 * i], rays.directions[3 * i + 1], rays.directions[3 * i + 2]);
    list.add((street_from_world * o.homogeneous()).head<3>(), street_from_world.topLeftCorner<3, 3>() * d);
  }
  LidarReturns out;
  for (int64_t begin = 0; begin < list.count(); begin += kRenderRays) {
    const int64_t end = std::min(list.count(), begin + kRenderRays);
    const Shaded seen = shade(street(log, list), part_of(list, begin, end), {}, false);
    eval({seen.depth, seen.opacity, seen.alpha});
    const std::vector<float> depth = seen.depth.to_host(), opacity = seen.opacity.to_host();
    for (size_t i = 0; i < depth.size(); ++i) out.depths.push_back(opacity[i] < 0.5f ? 0.f : depth[i]);
    for (const int32_t owner : street_owners(seen.alpha, seen.samples).to_host<int32_t>())
      out.actors.push_back(owner + 1);
  }
  return out;
}

/// The asset in front of the sky of its log; then what is sky turns white.
Picture GenAssets::render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) {
  const AssetPlace place = place_of(asset);
  const Log& log = logs_[place.log];
  const int scale = image_->scale();
  const int64_t columns = (camera.width + scale - 1) / scale, rows = (camera.height + scale - 1) / scale;
  RayList rays;
  rays.times.push_back(0);
  for (int64_t y = 0; y < rows; ++y)
    for (int64_t x = 0; x < columns; ++x)
      rays.add(box_from_camera.block<3, 1>(0, 3),
               box_from_camera.topLeftCorner<3, 3>() *
                   direction(camera, {(static_cast<double>(x) + 0.5) * scale, (static_cast<double>(y) + 0.5) * scale}));
  const Stage stage = alone(log, place);
  Tensors features, opacity;
  for (int64_t begin = 0; begin < rays.count(); begin += kRenderRays) {
    const Shaded seen = shade(stage, part_of(rays, begin, std::min(rays.count(), begin + kRenderRays)), {}, false);
    eval({seen.features, seen.actor_opacity});
    features.push_back(stop_gradient(seen.features));
    opacity.push_back(stop_gradient(seen.actor_opacity));
  }
  const auto map = [&](const Tensors& parts, int64_t channels) {
    return permute(reshape(concat(parts, 0), {1, rows, columns, channels}), {0, 3, 1, 2});
  };
  const Tensor image = image_of(map(features, config_.field.features), Tensor());
  const Tensor covered = resize_bilinear(map(opacity, 1), image.dim(2), image.dim(3));
  const auto pixels = [&](const Tensor& x) {
    const Tensor cut = slice(slice(x, 2, 0, camera.height), 3, 0, camera.width);
    return permute(reshape(cut, {x.dim(1), camera.height, camera.width}), {1, 2, 0}).to_host();
  };
  Picture out;
  out.width = camera.width;
  out.height = camera.height;
  out.rgb = pixels(image * covered + (1.f - covered));
  out.opacity = pixels(covered);
  return out;
}

/// A log of its own, whose sky is that of the run's first log by the same light.
AssetName GenAssets::add_asset(const NewAsset& asset) {
  if (!decoder_)
    throw Error(Fault::usage,
                "the run learned its actors' planes directly (decoder.use = false): no code can be shown");
  const size_t numbers = static_cast<size_t>(config_.code_channels) * static_cast<size_t>(config_.code_side) *
                         static_cast<size_t>(config_.code_side);
  if (asset.code.size() != numbers)
    throw Error(Fault::data, text("a code of ", asset.code.size(), " numbers, the run's have ", numbers));
  const auto alike =
      std::find_if(logs_.begin(), logs_.end(), [&](const Log& log) { return log.scene.night == asset.night; });
  const Log& host = alike == logs_.end() ? logs_.front() : *alike;
  std::vector<float> row = asset.code;
  row.resize(numbers * (config_.variational ? 2 : 1));
  Log log;
  log.scene.night = asset.night;
  const AssetName name = added_asset(logs_.size(), 0);
  log.scene.actors.push_back({name.actor_id, kAssetClasses[asset.asset_class], asset.size, false, {}, {}});
  log.space = host.space;
  log.background = host.background;
  log.common_background = host.common_background;
  log.classes = {asset.asset_class};
  log.assets = from_host(row, {1, static_cast<int64_t>(row.size())});
  logs_.push_back(std::move(log));
  find_looks();
  return name;
}

AssetSamples GenAssets::sample_asset(const AssetName& asset, const std::vector<float>& points) {
  const AssetPlace place = place_of(asset);
  const auto count = static_cast<int64_t>(points.size() / 3);
  const Tensor planes = stop_gradient(decode({place}, {}).planes), owners = dense_zeros(count);
  const float scale = cube_scale(size_of(place));
  const auto geometry = [&](const Tensor& at) {
    return field_->geometry(sample_planes(planes, in_cube(at * scale + 0.5f), owners));
  };
  const Tensor at = from_host(points, {count, 3});
  // The way outwards by differences over the corners of a tetrahedron.
  Tensor outwards = zeros({count, 3});
  for (const std::vector<float>& corner :
       std::vector<std::vector<float>>{{1, -1, -1}, {-1, -1, 1}, {-1, 1, -1}, {1, 1, 1}}) {
    const Tensor step = from_host(corner, {1, 3});
    outwards = outwards + step * unsqueeze(geometry(at + step * kNormalStep).distance, 1);
  }
  const Tensor normal = outwards * rsqrt(sum(square(outwards), {{1}, true}) + 1e-12f);
  const StreetField::Geometry here = geometry(at);
  const Tensor feature = field_->features(here.inner, spherical_harmonics(-normal));
  // The colour that the image decoder gives to a surface of this feature alone.
  const int64_t side = 3, middle = side * image_->scale() / 2;
  const Tensor image = (*image_)(broadcast_to(reshape(feature, {count, config_.field.features, 1, 1}),
                                              {count, config_.field.features, side, side}));
  const Tensor colour = reshape(slice(slice(image, 2, middle, middle + 1), 3, middle, middle + 1), {count, 3});
  AssetSamples out;
  eval({here.distance, colour});
  out.distances = here.distance.to_host();
  out.colours = colour.to_host();
  return out;
}

}  // namespace cloam
