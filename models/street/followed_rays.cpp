// See followed_rays.h. Kernels of kernels/street.cl, said with ops.
#include "models/street/followed_rays.h"

#include <algorithm>
#include <cstddef>

namespace cloam {
namespace {

/// [1,3] of a grid's numbers.
Tensor three_of(const std::vector<float>& numbers, std::size_t first) {
  return from_host(std::vector<float>(&numbers[first], &numbers[first] + 3), {1, 3});
}

/// Places [S,3] of the street, and how they lie in the contracted cube.
struct Cube {
  Tensor centre, half;  // [1,3]
  explicit Cube(const StreetGrid& grid) {
    const std::vector<float> numbers = grid.numbers.to_host();
    centre = three_of(numbers, 7), half = three_of(numbers, 10);
  }
  Tensor contracted(const Tensor& places) const {
    const Tensor at = (places - centre) / half, norm = maximum(max(abs(at), {{1}, true}), 1.f);
    return at * ((2.f - 1.f / norm) / norm) * 0.25f + 0.5f;
  }
  Tensor uncontracted(const Tensor& points) const {
    const Tensor at = points * 4.f - 2.f, norm = maximum(max(abs(at), {{1}, true}), 1.f);
    return at / (norm * maximum(2.f - norm, 1e-6f)) * half + centre;
  }
};

/// The row of `boxes` of each owner at each moment, [moments * owners].
struct BoxRows {
  Tensor rows;
  int32_t owners;
};
BoxRows box_rows(const StreetBoxes& boxes) {
  constexpr std::size_t kOwner = offsetof(StreetBox, owner) / sizeof(float), kNumbers = sizeof(StreetBox) / 4;
  const std::vector<int32_t> first = boxes.first.to_host<int32_t>();
  const std::vector<float> numbers = boxes.boxes.to_host();
  const auto owner_of = [&](int32_t box) {
    return static_cast<int32_t>(numbers[static_cast<std::size_t>(box) * kNumbers + kOwner]);
  };
  int32_t owners = 0;
  for (int32_t box = 0; box < first.back(); ++box) owners = std::max(owners, owner_of(box) + 1);
  std::vector<int32_t> rows((first.size() - 1) * static_cast<std::size_t>(owners));
  for (std::size_t moment = 0; moment + 1 < first.size(); ++moment)
    for (int32_t box = first[moment]; box < first[moment + 1]; ++box)
      rows[moment * static_cast<std::size_t>(owners) + static_cast<std::size_t>(owner_of(box))] = box;
  return {from_host(rows, {static_cast<int64_t>(rows.size())}), owners};
}

}  // namespace

StreetSamples followed_in_boxes(const StreetSamples& samples, const StreetRays& rays, const StreetBoxes& boxes) {
  StreetSamples out = samples;
  if (out.t.dim(0) == out.points.dim(0)) return out;
  const int64_t background = out.points.dim(0), all = out.t.dim(0), count = all - background;
  std::vector<float> numbers(static_cast<std::size_t>(rays.origins.dim(0)));
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<float>(i);
  const Tensor by_place = segment_spread(from_host(numbers, {rays.origins.dim(0)}), out.offsets, all);
  const auto of_actors = [&, order = sort(out.rows).order](const Tensor& places) {
    return slice(gather_rows(places, order), 0, background, all);
  };
  const Tensor ray = cast(of_actors(by_place), DType::i32), t = unsqueeze(of_actors(out.t), 1);
  const BoxRows known = box_rows(boxes);
  const Tensor box =
      gather_rows(boxes.boxes, gather_rows(known.rows, gather_rows(rays.moments, ray) * known.owners + out.owners));
  const Tensor axes = reshape(slice(box, 1, 0, 9), {count, 3, 3});
  const auto turned = [&](const Tensor& v) { return sum(axes * unsqueeze(v, 1), {{2}}); };
  const Tensor way = gather_rows(rays.directions, ray);
  const Tensor place = gather_rows(rays.origins, ray) + t * way - slice(box, 1, 9, 12);
  out.actor_directions = turned(way);
  out.actor_points = turned(place) * slice(box, 1, 15, 16) + 0.5f;
  return out;
}

StreetSamples followed(const StreetSamples& samples, const StreetRays& rays, const StreetBoxes& boxes,
                       const StreetGrid& grid) {
  StreetSamples out = samples;
  const Cube cube(grid);
  const Tensor origins = gather_rows(rays.origins, samples.ray), ways = gather_rows(rays.directions, samples.ray);
  // The sky's samples have no distance of their own in t.
  const Tensor t = stop_gradient(sum((cube.uncontracted(samples.points) - origins) * ways, {{1}, true}));
  out.points = cube.contracted(origins + t * ways);
  return followed_in_boxes(out, rays, boxes);
}

}  // namespace cloam
