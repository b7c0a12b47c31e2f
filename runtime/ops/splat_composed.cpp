// Gaussian splatting of general ops: the reference of the fused kernels, and their derivatives beyond the first.
#include "runtime/ops/splat_composed.h"

#include <limits>

namespace cloam {
namespace {

Tensor column(const Tensor& x, int i) { return slice(x, 1, i, i + 1); }
Tensor over_rows(const Tensor& x) { return sum(x, {.axes = {1}, .keep = true}); }

/// [G,4] of any length -> [G,3,3].
Tensor rotation_of(const Tensor& rotations) {
  const Tensor q = rotations / sqrt(maximum(over_rows(square(rotations)), 1e-24f));
  const Tensor w = column(q, 0), x = column(q, 1), y = column(q, 2), z = column(q, 3);
  const Tensor rows = concat({1.f - 2.f * (y * y + z * z), 2.f * (x * y - w * z), 2.f * (x * z + w * y),  //
                              2.f * (x * y + w * z), 1.f - 2.f * (x * x + z * z), 2.f * (y * z - w * x),  //
                              2.f * (x * z - w * y), 2.f * (y * z + w * x), 1.f - 2.f * (x * x + y * y)},
                             1);
  return reshape(rows, {rotations.dim(0), 3, 3});
}

/// The 2D covariance [G,1] each, and its determinants.
struct Covariance {
  Covariance(const Tensor& p, const Tensor& q, float blur) : xy(over_rows(p * q)) {
    const Tensor sharp_xx = over_rows(p * p), sharp_yy = over_rows(q * q);
    const auto minor = [&](int i, int j) { return square(column(p, i) * column(q, j) - column(p, j) * column(q, i)); };
    xx = sharp_xx + blur;
    yy = sharp_yy + blur;
    sharp = minor(1, 2) + minor(2, 0) + minor(0, 1);  // without cancellation (Lagrange's identity)
    full = sharp + blur * (sharp_xx + sharp_yy + blur);
  }
  Tensor xx, xy, yy, sharp, full;
};

/// Columns [G,1] of real harmonics 0 to 15 with 3DGS's signs, of unit directions [G,3].
Tensor harmonics_of(const Tensor& d, int bands) {
  const Tensor x = column(d, 0), y = column(d, 1), z = column(d, 2), xx = x * x, yy = y * y, zz = z * z;
  constexpr float kOne = 0.48860251190f;
  const Tensors all = {0.28209479177f + 0.f * x,
                       -kOne * y,
                       kOne * z,
                       -kOne * x,
                       1.0925484306f * x * y,
                       -1.0925484306f * y * z,
                       0.31539156525f * (2.f * zz - xx - yy),
                       -1.0925484306f * x * z,
                       0.54627421529f * (xx - yy),
                       -0.59004358993f * y * (3.f * xx - yy),
                       2.8906114426f * x * y * z,
                       -0.45704579946f * y * (4.f * zz - xx - yy),
                       0.37317633259f * z * (2.f * zz - 3.f * xx - 3.f * yy),
                       -0.45704579946f * x * (4.f * zz - xx - yy),
                       1.4453057213f * z * (xx - yy),
                       -0.59004358993f * x * (xx - 3.f * yy)};
  return concat(Tensors(all.begin(), all.begin() + bands), 1);
}

/// Where the middles of each pair's 256 pixels lie: x and y [P,256].
std::pair<Tensor, Tensor> pixels_of(const Tensor& offsets, int64_t pairs, int64_t across) {
  const auto counted = [](int64_t n) { return cumsum(ones({n}), 0, {.exclusive = true}); };
  const Tensor tile = segment_spread(counted(offsets.dim(0) - 1), offsets, pairs), lane = counted(256);
  const auto places = [](const Tensor& of_tile, const Tensor& of_lane) {
    return unsqueeze(16.f * of_tile, 1) + of_lane + 0.5f;
  };
  const Tensor down = floor((tile + 0.5f) / static_cast<float>(across)), row = floor(lane / 16.f);
  return {places(tile - static_cast<float>(across) * down, lane - 16.f * row), places(down, row)};
}

/// Opacities [P,256] at the pixels; 0 below 1/255.
Tensor opacities(const Tensor& splats, const Tensor& x, const Tensor& y) {
  const Tensor dx = column(splats, 0) - x, dy = column(splats, 1) - y;
  const Tensor power =
      -0.5f * (column(splats, 2) * dx * dx + column(splats, 4) * dy * dy) - column(splats, 3) * dx * dy;
  const Tensor alpha = minimum(column(splats, 5) * exp(minimum(power, 0.f)), 0.99f);
  return where(alpha < 1.f / 255, 0.f, alpha);
}

/// [tiles,256,C] -> [C,H,W].
Tensor picture_of(const Tensor& tiles, const SplatPicture& picture) {
  const int64_t across = picture.across(), down = tiles.dim(0) / across, channels = tiles.dim(2);
  const Tensor planes = permute(reshape(tiles, {down, across, 16, 16, channels}), {4, 0, 2, 1, 3});
  const Tensor whole = reshape(planes, {channels, 16 * down, 16 * across});
  return slice(slice(whole, 1, 0, picture.height), 2, 0, picture.width);
}

}  // namespace

Tensor project_composed(const Tensors& in, const SplatLook& look) {
  const int64_t count = in[0].dim(0);
  const Tensor turn = slice(in[4], 2, 0, 3), shift = reshape(slice(in[4], 2, 3, 4), {count, 3});
  const Tensor t = sum(turn * unsqueeze(in[0], 1), {.axes = {2}}) + shift;
  const auto lens = [&](int i) { return slice(in[5], 0, i, i + 1); };
  const Tensor ahead = column(t, 2) > look.near, z = where(ahead, column(t, 2), 1.f);
  const Tensor n = matmul(turn, rotation_of(in[2])) * unsqueeze(exp(in[1]), 1);
  const auto row = [&](int i) { return reshape(slice(n, 1, i, i + 1), {count, 3}); };
  const auto projected = [&](int i) {
    const Tensor more = 0.15f * lens(4 + i) / lens(i);
    const Tensor slope =
        clamp(column(t, i) / z, -lens(2 + i) / lens(i) - more, (lens(4 + i) - lens(2 + i)) / lens(i) + more);
    return lens(i) / z * (row(i) - slope * row(2));
  };
  const Covariance cov(projected(0), projected(1), look.blur);
  const Tensor seen = ahead * (0.f < cov.full) * (cov.full <= std::numeric_limits<float>::max());
  const Tensor det = where(seen, cov.full, 1.f), opacity = sigmoid(unsqueeze(in[3], 1));
  const auto pixel = [&](int i) { return lens(i) * column(t, i) / z + lens(2 + i); };
  const Tensor found = concat({pixel(0), pixel(1), cov.yy / det, -cov.xy / det, cov.xx / det,
                               look.antialiased ? opacity * sqrt(maximum(cov.sharp / det, 2.5e-5f)) : opacity, z},
                              1);
  return where(seen, found, from_host(std::vector<float>{0, 0, 1, 0, 1, 0, 0}, {1, 7}));
}

Tensor harmonic_sums_composed(const Tensors& in, int bands) {
  const Tensor towards = in[2] - in[3];
  const Tensor h = harmonics_of(towards / sqrt(maximum(over_rows(square(towards)), 1e-24f)), bands);
  const Tensor flat = 0.5f + column(h, 0) * in[0];
  if (bands == 1) return flat;
  return flat + sum(unsqueeze(slice(h, 1, 1, bands), 2) * slice(in[1], 1, 0, bands - 1), {.axes = {1}});
}

Tensor blend_composed(const Tensors& in, const SplatPicture& picture) {
  const Tensor &splats = in[0], &offsets = in[2];
  const int64_t pairs = splats.dim(0), tiles = picture.tiles();
  const auto [x, y] = pixels_of(offsets, pairs, picture.across());
  const Tensor alpha = opacities(splats, x, y), thickness = -log(1.f - alpha);
  const Tensor before = cumsum(pad(thickness, 0, 0, 1), 0, {.exclusive = true});
  const Tensor of_tile = gather_rows(before, slice(offsets, 0, 0, tiles));
  const Tensor through = exp(segment_spread(of_tile, offsets, pairs) - slice(before, 0, 0, pairs));
  const Tensor blended = cast(1e-4f <= through * (1.f - alpha), DType::f32);  // none behind the first that is not
  const Tensor sums = segment_sum(unsqueeze(blended * through * alpha, 2) * unsqueeze(in[1], 1), offsets);
  const Tensor left = exp(-segment_sum(blended * thickness, offsets));
  return picture_of(concat({sums, unsqueeze(left, 2)}, 2), picture);
}

Tensor splat_project_composed(const Cloud& cloud, const Tensor& view, const SplatCamera& camera, const Tensor& owners) {
  const std::vector<float> lens = {
      camera.fx, camera.fy, camera.cx, camera.cy, static_cast<float>(camera.width), static_cast<float>(camera.height)};
  const Tensor views =
      owners ? gather_rows(view, owners) : broadcast_to(unsqueeze(view, 0), {cloud.means.dim(0), 3, 4});
  return project_composed({cloud.means, cloud.scales, cloud.rotations, cloud.opacities, views, from_host(lens, {6})},
                          {camera.blur, camera.near, camera.antialiased});
}

Tensor splat_colours_composed(const Harmonics& harmonics, const Tensor& means, const Tensor& eye,
                              const Tensor& owners) {
  const int side = harmonics.degree + 1;
  const Tensor from = owners ? gather_rows(eye, owners) : eye;
  return maximum(harmonic_sums_composed({harmonics.first, harmonics.rest, means, from}, side * side), 0.f);
}

Blended splat_blend_composed(const Splats& splats, const SplatTiles& tiles) {
  const Tensor planes =
      blend_composed({gather_rows(splats.seen, tiles.ids), gather_rows(splats.colours, tiles.ids), tiles.offsets},
                     {tiles.height, tiles.width});
  const int64_t channels = splats.colours.dim(1);
  return {permute(slice(planes, 0, 0, channels), {1, 2, 0}),
          reshape(slice(planes, 0, channels, channels + 1), {tiles.height, tiles.width})};
}

}  // namespace cloam
