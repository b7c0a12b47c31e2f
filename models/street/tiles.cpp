// See tiles.h.
#include "models/street/tiles.h"

#include <algorithm>

#include "runtime/ops.h"

namespace cloam {
namespace {

size_t place(const HostMap& map, int64_t y, int64_t x) {
  return static_cast<size_t>((y * map.columns + x) * map.channels);
}

}  // namespace

std::vector<Tile> tiles_of(const HostMap& map, int64_t side) {
  std::vector<Tile> all;
  for (int64_t y = 0; y < map.rows; y += side)
    for (int64_t x = 0; x < map.columns; x += side)
      all.push_back({x, y, std::min(side, map.columns - x), std::min(side, map.rows - y)});
  return all;
}

Tile widened(const Tile& w, int64_t halo, const HostMap& map) {
  const int64_t x = std::max<int64_t>(0, w.x - halo), y = std::max<int64_t>(0, w.y - halo);
  return {x, y, std::min(map.columns, w.x + w.columns + halo) - x, std::min(map.rows, w.y + w.rows + halo) - y};
}

Tensor cut(const HostMap& map, const Tile& w) {
  std::vector<float> part;
  for (int64_t y = w.y; y < w.y + w.rows; ++y) {
    const float* from = &map.values[place(map, y, w.x)];
    part.insert(part.end(), from, from + w.columns * map.channels);
  }
  return parameter(part, {1, w.rows, w.columns, map.channels});
}

void add_to(HostMap& map, const Tile& w, const std::vector<float>& part) {
  size_t from = 0;
  for (int64_t y = w.y; y < w.y + w.rows; ++y)
    for (size_t to = place(map, y, w.x), end = to + static_cast<size_t>(w.columns * map.channels); to < end; ++to)
      map.values[to] += part[from++];
}

Tensor cropped(const Tensor& image, const Tile& w, int scale) {
  return slice(slice(image, 2, w.y * scale, (w.y + w.rows) * scale), 3, w.x * scale, (w.x + w.columns) * scale);
}

Tensors GradientSums::add(const Tensor& loss, const Tensors& also, const Tensors& more) {
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

}  // namespace cloam
