// GenAssets on whole images: a graph of all their rays and pixels would not fit in memory, so a step goes through them
// in tiles. Features first, without gradients; then pixels window by window, which gives the gradients by features;
// then the rays again, tile by tile, with gradients; last the asset decoder, once.
#include <algorithm>

#include "models/methods/genassets.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int64_t kMultiple = 4;  // of cells a window: the discriminator halves pixels four times

/// Sums of gradients over tiles. Each is evaluated at once, so that a tile's graph is gone before the next.
class Sums {
 public:
  explicit Sums(const Tensors& wanted) : wanted_(wanted), sums_(wanted.size()) {}
  /// Returns the gradients by `also` and the values of `more`, evaluated.
  Tensors add(const Tensor& loss, const Tensors& also = {}, const Tensors& more = {}) {
    Tensors by = wanted_;
    by.insert(by.end(), also.begin(), also.end());
    const Tensors parts = grad_where_reached(loss, by);
    Tensors pending, aside(parts.begin() + static_cast<std::ptrdiff_t>(sums_.size()), parts.end());
    aside.insert(aside.end(), more.begin(), more.end());
    for (size_t i = 0; i < sums_.size(); ++i)
      if (parts[i]) pending.push_back(sums_[i] = stop_gradient(sums_[i] ? sums_[i] + parts[i] : parts[i]));
    for (const Tensor& tensor : aside)
      if (tensor) pending.push_back(tensor);
    eval(pending);
    return aside;
  }
  const Tensors& sums() const { return sums_; }

 private:
  Tensors wanted_, sums_;
};

/// A map [rows,columns,channels] on the host.
struct Map {
  int64_t rows, columns, channels;
  std::vector<float> values;
  size_t at(int64_t y, int64_t x) const { return static_cast<size_t>((y * columns + x) * channels); }
};

struct Cells {
  int64_t x, y, columns, rows;
};

/// A parameter [1,rows,columns,channels].
Tensor cut(const Map& map, const Cells& w) {
  std::vector<float> part;
  for (int64_t y = w.y; y < w.y + w.rows; ++y) {
    const float* from = &map.values[map.at(y, w.x)];
    part.insert(part.end(), from, from + w.columns * map.channels);
  }
  return parameter(part, {1, w.rows, w.columns, map.channels});
}

void add_to(Map& map, const Cells& w, const std::vector<float>& part) {
  size_t from = 0;
  for (int64_t y = w.y; y < w.y + w.rows; ++y)
    for (size_t to = map.at(y, w.x), end = to + static_cast<size_t>(w.columns * map.channels); to < end; ++to)
      map.values[to] += part[from++];
}

/// The window and the cells around it that lie in the map.
Cells widened(const Cells& w, const Map& map) {
  const int64_t x = std::max<int64_t>(0, w.x - kHalo), y = std::max<int64_t>(0, w.y - kHalo);
  return {x, y, std::min(map.columns, w.x + w.columns + kHalo) - x, std::min(map.rows, w.y + w.rows + kHalo) - y};
}

Tensor cropped(const Tensor& image, const Cells& cells, int scale) {
  return slice(slice(image, 2, cells.y * scale, (cells.y + cells.rows) * scale), 3, cells.x * scale,
               (cells.x + cells.columns) * scale);
}

std::vector<Cells> windows(const Map& map, int64_t side) {
  side = std::max(kMultiple, side / kMultiple * kMultiple);
  std::vector<Cells> all;
  for (int64_t y = 0; y < map.rows; y += side)
    for (int64_t x = 0; x < map.columns; x += side)
      all.push_back({x, y, std::min(side, map.columns - x), std::min(side, map.rows - y)});
  return all;
}

}  // namespace

/// What the passes over one image share.
struct GenAssets::WholeImage {
  const GenAssets& method;
  const Log& log;
  Drawing how;
  RayList rays, returns;
  Tensor truth;
  Decoded decoded, given;         // of all actors that may be seen; given: with the planes as a leaf
  Map features = {}, slope = {};  // slope: the gradient by features
  int64_t samples = 0;
  double squared = 0;  // mean over the image

  int64_t end_of(int64_t begin) const { return std::min(rays.count(), begin + method.config_.tile_rays); }
  Shaded shade(int64_t begin) const {
    return method.shade(method.street(log, rays), part_of(rays, begin, end_of(begin)), how, true, &given);
  }
  void look();
  void decode_pixels(Sums& sums);
  void shade_again(Sums& sums);
};

/// Features of all rays, and how much light is left there.
void GenAssets::WholeImage::look() {
  const int scale = method.image_->scale();
  features = {truth.dim(2) / scale, truth.dim(3) / scale, method.config_.field.features + 3, {}};
  for (int64_t begin = 0; begin < rays.count(); begin = end_of(begin)) {
    const Shaded seen = shade(begin);
    const Tensor light = seen.shadow ? seen.shadow : ones({end_of(begin) - begin, 3});
    const std::vector<float> values = stop_gradient(concat({seen.features, light}, 1)).to_host();
    features.values.insert(features.values.end(), values.begin(), values.end());
    samples += seen.samples.t.dim(0);
  }
  slope = {features.rows, features.columns, features.channels, std::vector<float>(features.values.size(), 0.f)};
}

void GenAssets::WholeImage::decode_pixels(Sums& sums) {
  const int scale = method.image_->scale();
  const int64_t wide = method.config_.field.features;
  for (const Cells& inner : windows(features, method.config_.tile_side)) {
    const Cells outer = widened(inner, features);
    const Tensor cells = cut(features, outer), map = permute(cells, {0, 3, 1, 2});
    const Tensor whole = method.image_of(slice(map, 1, 0, wide), slice(map, 1, wide, wide + 3));
    const Tensor image = cropped(whole, {inner.x - outer.x, inner.y - outer.y, inner.columns, inner.rows}, scale);
    const Tensor photo = cropped(truth, inner, scale);
    const double share =
        static_cast<double>(inner.columns * inner.rows) / static_cast<double>(features.rows * features.columns);
    const Tensors found = sums.add(method.window_loss(image, photo, static_cast<float>(share)), {cells},
                                   {mean(square(stop_gradient(image) - photo))});
    add_to(slope, outer, found[0].to_host());
    squared += share * static_cast<double>(found[1].item());
  }
}

void GenAssets::WholeImage::shade_again(Sums& sums) {
  const int64_t wide = method.config_.field.features, channels = slope.channels;
  for (int64_t begin = 0; begin < rays.count(); begin = end_of(begin)) {
    const int64_t end = end_of(begin);
    const std::vector<float> part(slope.values.begin() + begin * channels, slope.values.begin() + end * channels);
    const Tensor by = from_host(part, {end - begin, channels});
    const Shaded seen = shade(begin);
    Tensor along = sum(seen.features * slice(by, 1, 0, wide));
    if (seen.shadow) along = along + sum(seen.shadow * slice(by, 1, wide, wide + 3));
    sums.add(along);
  }
}

/// The image's terms on one window, weighted by its share of the image.
Tensor GenAssets::window_loss(const Tensor& image, const Tensor& truth, float share) const {
  Tensor total = mean(square(image - truth)) * (config_.weight_rgb * share);
  const int64_t least = std::min(image.dim(2), image.dim(3));
  if (perceptual_ && least >= perceptual_->smallest)
    total = total + perceptual_loss(*perceptual_, image, truth) * (config_.weight_perceptual * share);
  const int64_t multiple = int64_t{1} << (discriminator_ ? discriminator_->blocks.size() : 0);
  if (discriminator_ && image.dim(2) % multiple == 0 && image.dim(3) % multiple == 0 && least >= 2 * multiple)
    total = total + adversarial_loss(image, truth) * share;
  return total;
}

GenAssets::WholeImage GenAssets::whole_image(const Progress& progress) const {
  HostRandom random(seed_, static_cast<uint64_t>(progress.step));
  const Log& log = logs_[random.below(logs_.size())];
  WholeImage image{*this, log, drawing(log, progress, true), {}, {}, {}, {}, {}};
  image.truth = log.data->add_image(image.rays, *log.space, random);
  image.returns.actors = image.rays.actors;
  if (log.data->has_lidar()) log.data->add_returns(image.returns, *log.space, random, config_.lidar_rays);
  Met met;
  met.slot_of.assign(log.looks.size() + 1, -1);
  for (size_t a = 0; a < log.looks.size(); ++a)
    if (image.rays.actors[a]) {
      met.slot_of[a] = static_cast<int32_t>(met.assets.size());
      met.assets.push_back(log.looks[a]);
    }
  image.decoded = image.given = decode_met(met, image.how);
  if (image.decoded.planes)
    image.given.planes = parameter(image.decoded.planes.to_host(), image.decoded.planes.shape());
  return image;
}

Gradients GenAssets::gradients_in_tiles(const Progress& progress, const Tensors& wanted) {
  WholeImage image = whole_image(progress);
  const Tensor& planes = image.given.planes;
  Tensors reached = wanted;
  if (planes) reached.push_back(planes);
  Sums sums(reached);
  image.look();
  image.decode_pixels(sums);
  image.shade_again(sums);
  Tensor total = full({}, config_.weight_rgb * static_cast<float>(image.squared));
  observed_ = {full({1}, static_cast<float>(image.squared))};
  if (image.returns.count() > 0) {
    const Shaded seen = shade(street(image.log, image.returns), image.returns, image.how, false, &image.given);
    const Tensor ranges = from_host(image.returns.ranges, {image.returns.count()});
    const Tensor of_lidar =
        lidar_loss(seen.depth, ranges) * config_.weight_lidar + mean(seen.stray) * config_.weight_stray;
    const Tensors found =
        sums.add(of_lidar, {}, {stop_gradient(of_lidar), mean(minimum(abs(stop_gradient(seen.depth) - ranges), 1.f))});
    total = total + found[0];
    observed_.push_back(found[1]);
  }
  last_samples_ = image.samples;
  last_actors_ = planes ? planes.dim(1) : 0;
  met_codes_ = image.decoded.codes;
  Gradients out{total, sums.sums()};
  if (!planes) return out;
  const Tensor by_planes = out.of_parameters.back();
  out.of_parameters.pop_back();
  Tensor along = by_planes ? sum(image.decoded.planes * by_planes) : Tensor(0.f);
  if (image.decoded.kl) along = along + image.decoded.kl * config_.weight_kl;
  Sums of_decoder(wanted);
  of_decoder.add(along);
  for (size_t i = 0; i < wanted.size(); ++i)
    if (const Tensor& more = of_decoder.sums()[i])
      out.of_parameters[i] = out.of_parameters[i] ? out.of_parameters[i] + more : more;
  return out;
}

}  // namespace cloam
