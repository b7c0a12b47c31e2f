// See image_source.h.
#include "models/batches/image_source.h"

#include <algorithm>
#include <numeric>

#include "models/batches/own_rows.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr float kLeastAhead = 1e-3f;  // of a unit direction: beyond it a depth says nothing of the distance

/// [C,H,W] of [H,W,C] bytes.
Tensor planar(const std::vector<uint8_t>& pixels, int channels, int height, int width) {
  const size_t plane = static_cast<size_t>(height) * static_cast<size_t>(width);
  std::vector<uint8_t> out(plane * static_cast<size_t>(channels));
  for (size_t i = 0; i < plane; i++)
    for (size_t c = 0; c < static_cast<size_t>(channels); c++)
      out[c * plane + i] = pixels[i * static_cast<size_t>(channels) + c];
  return from_host(out, {channels, height, width});
}

Tensor unit(const Tensor& vectors) { return vectors / sqrt(sum(square(vectors), {{1}, true})); }

constexpr int kSquare = 4, kPlaces = kSquare * kSquare;

/// `chance` [R] in [0,1) says which are of 4, of 2 pixels a side, or of one, as those are that no photo holds. inside:
/// their first corner, which moves where a square would reach beyond the photo.
PixelSquares squares_of(const Tensor& chance, float coarse, const Tensor& inside, const Tensor& width,
                        const Tensor& pixels) {
  const Tensor height = pixels / width, drawn = where(chance < coarse / 2, 4, where(chance < coarse, 2, 1)),
               side = where(minimum(width, height) < drawn, 1, drawn);
  std::vector<int32_t> along;
  for (int i = 0; i < kSquare; i++) along.push_back(i);
  const auto places = [&](const Tensor& corner, const Tensor& extent, const Shape& shape) {
    const Tensor steps = from_host(along, {1, kSquare}) * unsqueeze(side, 1) / kSquare;
    return reshape(unsqueeze(minimum(corner, extent - side), 1) + steps, shape);
  };
  const int64_t rays = side.dim(0);
  const Tensor row = places(inside / width, height, {rays, kSquare, 1}) * reshape(width, {rays, 1, 1});
  return {reshape(row + places(modulo(inside, width), width, {rays, 1, kSquare}), {rays, kPlaces}), side};
}

}  // namespace

PixelSource::PixelSource(const Scene& scene, const PhotoStore& photos, const SceneFrame& frame, const RayRange& range)
    : frame_(frame), range_(range) {
  std::vector<int32_t> first_direction, frames;
  std::vector<float> directions, widths, poses;
  for (const Camera& camera : photos.listed().cameras) {
    first_direction.push_back(static_cast<int32_t>(directions.size() / 3));
    const std::vector<float> d = unit_directions(camera);
    directions.insert(directions.end(), d.begin(), d.end());
    const std::vector<float> w = pixel_widths(d, camera.width, camera.height);
    widths.insert(widths.end(), w.begin(), w.end());
  }
  std::vector<uint8_t> rgba, mask;
  std::vector<float> depths;
  const auto [masked, has_depths] = photos.planes();
  for (size_t place = 0; place < photos.size(); ++place) {
    const std::shared_ptr<const FramePixels> photo = photos[place];
    const FramePixels& f = *photo;
    const size_t count = f.rgba.size() / 4;
    frames.insert(frames.end(),
                  {static_cast<int32_t>(rgba.size() / 4), static_cast<int32_t>(count),
                   first_direction[static_cast<size_t>(f.camera)], scene.frames[f.frame].camera, f.width});
    append_pose(poses, scene.frames[f.frame].world_from_camera, frame);
    rgba.insert(rgba.end(), f.rgba.begin(), f.rgba.end());
    if (masked && f.mask.empty()) mask.insert(mask.end(), count, 255);
    mask.insert(mask.end(), f.mask.begin(), f.mask.end());
    if (has_depths && f.depth.empty()) depths.insert(depths.end(), count, 0.f);
    for (const float depth : f.depth) depths.push_back(depth * static_cast<float>(frame.scale));
  }
  if (frames.empty()) throw Error(Fault::data, "no training image is left");
  const auto frame_count = static_cast<int64_t>(photos.size()), pixel_count = static_cast<int64_t>(rgba.size() / 4);
  if (pixel_count > int64_t{1} << 29)
    throw Error(Fault::memory, text(pixel_count, " training pixels are more than fit: use a larger --downscale"));
  rgba_ = from_host(rgba, {pixel_count, 4});
  if (masked) mask_ = from_host(mask, {pixel_count});
  if (has_depths) depth_ = from_host(depths, {pixel_count});
  directions_ = from_host(directions, {static_cast<int64_t>(directions.size() / 3), 3});
  widths_ = from_host(widths, {static_cast<int64_t>(widths.size())});
  poses_ = from_host(poses, {frame_count, 12});
  frames_ = from_host(frames, {frame_count, 5});
}

PixelBatch PixelSource::draw(int64_t count, const RandomKey& key, const Share& share, const LearnedCameras& learned,
                             float coarse) const {
  const auto uniform = [&](uint32_t stream) {
    return own_rows(random_uniform({count}, {key.seed, key.step, key.stream + stream}), share);
  };
  const Tensor frame = own_rows(random_below({count}, frames_.dim(0), key), share);
  const Tensor record = gather_rows(frames_, frame);
  const auto column = [&](int i) { return reshape(slice(record, 1, i, i + 1), {share.size(count)}); };
  const Tensor pixels = column(1),
               inside = minimum(cast(uniform(1) * cast(pixels, DType::f32), DType::i32), pixels - 1);
  Seen seen = coarse > 0 ? squares(column(0), column(2), squares_of(uniform(2), coarse, inside, column(4), pixels))
                         : single(column(0) + inside, column(2) + inside);
  PixelBatch out;
  out.widths = seen.widths;
  out.rgba = seen.rgba;
  out.used = seen.used;
  Tensor towards = seen.directions;
  const LearnedLenses lenses = lenses_of(learned.lenses, column(3));
  if (!lenses.as_given()) towards = unit(directions_through(lenses, towards));
  if (lenses.focals) out.widths = out.widths / reshape(stop_gradient(lenses.focals), out.widths.shape());
  out.rays = world_rays(towards, gather_rows(learned.poses ? learned.poses : poses_, frame), frame_, range_);
  if (depth_) {
    const Tensor ahead = reshape(slice(towards, 1, 2, 3), {share.size(count)});
    out.depths = where(ahead > kLeastAhead, seen.depths / maximum(ahead, kLeastAhead), 0.f);
  }
  return out;
}

PixelSource::Seen PixelSource::single(const Tensor& pixel, const Tensor& direction) const {
  Seen out{gather_rows(directions_, direction), gather_rows(widths_, direction),
           cast(gather_rows(rgba_, pixel), DType::f32) * (1.f / 255.f)};
  if (mask_) out.used = cast(gather_rows(mask_, pixel) > 0, DType::f32);
  if (depth_) out.depths = gather_rows(depth_, pixel);
  return out;
}

/// Means over the squares; a square is used if all of it is, and has a depth if it is one pixel.
PixelSource::Seen PixelSource::squares(const Tensor& first_pixel, const Tensor& first_direction,
                                       const PixelSquares& at) const {
  const int64_t rays = at.side.dim(0);
  const auto flat = [&](const Tensor& first) { return reshape(unsqueeze(first, 1) + at.places, {rays * kPlaces}); };
  const auto by_square = [&](const Tensor& all) { return reshape(all, {rays, kPlaces, -1}); };
  const Seen all = single(flat(first_pixel), flat(first_direction));
  const Tensor rgba = by_square(all.rgba), alpha = slice(rgba, 2, 3, 4), opaque = sum(alpha, {{1}});
  const Tensor rgb = sum(slice(rgba, 2, 0, 3) * alpha, {{1}}) / maximum(opaque, 1e-6f);
  Seen out{unit(mean(by_square(all.directions), {{1}})),
           mean(reshape(all.widths, {rays, kPlaces}), {{1}}) * cast(at.side, DType::f32),
           concat({rgb, opaque * (1.f / kPlaces)}, 1)};
  if (mask_) out.used = min(reshape(all.used, {rays, kPlaces}), {{1}});
  if (depth_)
    out.depths = where(equal(at.side, 1), reshape(slice(reshape(all.depths, {rays, kPlaces}), 1, 0, 1), {rays}), 0.f);
  return out;
}

PhotoSource::PhotoSource(const Scene& scene, const Pixels& pixels) {
  for (const FramePixels& f : pixels.frames)
    photographs_.push_back({planar(f.rgba, 4, f.height, f.width),
                            f.mask.empty() ? Tensor() : from_host(f.mask, {f.height, f.width}),
                            f.depth.empty() ? Tensor() : from_host(f.depth, {f.height, f.width}),
                            pixels.cameras[static_cast<size_t>(f.camera)], scene.frames[f.frame].world_from_camera,
                            scene.frames[f.frame].camera});
  if (photographs_.empty()) throw Error(Fault::data, "no training image is left");
}

size_t PhotoSource::draw(uint64_t seed, int64_t step, const Share& share) const {
  const auto count = static_cast<int64_t>(photographs_.size()), place = (step - 1) * share.ranks + share.rank;
  const std::vector<float> keys = random_uniform({count}, {seed, static_cast<uint32_t>(place / count), 0}).to_host();
  std::vector<size_t> order(keys.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return keys[a] < keys[b]; });
  return order[static_cast<size_t>(place % count)];
}

}  // namespace cloam
