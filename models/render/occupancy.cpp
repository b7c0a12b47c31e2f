// Occupancy grid.
#include "models/render/occupancy.h"

#include <algorithm>
#include <cstring>

#include "models/io/tensors.h"
#include "runtime/error.h"
#include "runtime/ops/volume.h"

namespace cloam {
namespace {

constexpr int64_t kStride = 1000003;  // prime, so it divides no side^3 and the sweep repeats no cell
constexpr int64_t kMaxUpdates = int64_t{1} << 32;
constexpr float kAllOccupied = -1;  // a threshold below any density

}  // namespace

OccupiedCells::OccupiedCells(const std::vector<float>& values, int side, float threshold) : side_(side), cells_() {
  cells_.reserve(values.size());
  for (const float value : values) cells_.push_back(value > threshold);
}

Eigen::Vector3i OccupiedCells::cell_at(const Eigen::Vector3d& point) const {
  return (point * side_).cwiseMax(0.0).cwiseMin(side_ - 1.0).cast<int>();
}

bool OccupiedCells::at(int x, int y, int z) const {
  const auto side = static_cast<std::size_t>(side_);
  return cells_[(static_cast<std::size_t>(z) * side + static_cast<std::size_t>(y)) * side +
                static_cast<std::size_t>(x)];
}

void OccupiedCells::clear_empty(const std::vector<float>& points, std::vector<float>& densities) const {
  for (std::size_t i = 0; i < densities.size(); ++i) {
    const Eigen::Vector3i cell = cell_at({points[3 * i], points[3 * i + 1], points[3 * i + 2]});
    if (!at(cell.x(), cell.y(), cell.z())) densities[i] = 0;
  }
}

bool OccupiedCells::none_in(const Eigen::AlignedBox3d& box) const {
  const Eigen::Vector3i low = cell_at(box.min()), high = cell_at(box.max());
  for (int z = low.z(); z <= high.z(); ++z)
    for (int y = low.y(); y <= high.y(); ++y)
      for (int x = low.x(); x <= high.x(); ++x)
        if (at(x, y, z)) return false;
  return true;
}

OccupiedCells OccupancyGrid::occupied() const { return {values_.to_host(), options_.side, threshold_}; }

OccupancyGrid::OccupancyGrid(const OccupancyOptions& options) : options_(options) {
  const int64_t cells = int64_t{options.side} * options.side * options.side;
  values_ = from_host(std::vector<float>(static_cast<size_t>(cells), 0.f), {cells});
  threshold_ = kAllOccupied;
}

void OccupancyGrid::update(const Density& density, const RandomKey& key) {
  if (updates_ > 0) return visit_cells(density, key), refresh_threshold();
  const int64_t rounds = (values_.dim(0) + options_.cells_per_update - 1) / options_.cells_per_update;
  for (int64_t i = 0; i < rounds; i++)
    visit_cells(density, {key.seed, key.step, key.stream + static_cast<uint32_t>(i)});
  refresh_threshold();
}

void OccupancyGrid::visit_cells(const Density& density, const RandomKey& key) {
  const int64_t cells = values_.dim(0), count = std::min<int64_t>(options_.cells_per_update, cells);
  const int64_t start = (updates_ * count % cells) * (kStride % cells) % cells;
  const OccupancyCells visited =
      occupancy_cells(random_uniform({count, 3}, key), options_.side, start, kStride % cells);
  const bool first_sweep = updates_ * count < cells;
  occupancy_merge(values_, visited.cells, stop_gradient(density(visited.points)), first_sweep ? 0.f : options_.decay);
  updates_++;
}

void OccupancyGrid::rehearse(const Density& density, const RandomKey& key) {
  if (updates_ > 0) return;
  visit_cells(density, key);
  refresh_threshold();
  assign({{values_, zeros(values_.shape())}});
  updates_ = 0;
  threshold_ = kAllOccupied;
}

void OccupancyGrid::refresh_threshold() {
  // While all densities are low, what is clearly below their mean is empty (instant-ngp's rule).
  const float average = mean(minimum(values_, 10.f * options_.threshold)).item();
  threshold_ = std::min(options_.threshold, 0.5f * average);
}

TensorMap OccupancyGrid::state() const {
  return {{"occupancy.values", named(values_)}, {"occupancy.updates", named_integers({updates_})}};
}

void OccupancyGrid::restore(const TensorMap& state) {
  assign({{values_, tensor_from(state, "occupancy.values", values_.shape())}});
  updates_ = integers_from(state, "occupancy.updates", 1)[0];
  if (updates_ < 0 || updates_ > kMaxUpdates)
    throw Error(Fault::data, text("the checkpoint's occupancy.updates is ", updates_, ", want 0 to ", kMaxUpdates));
  threshold_ = kAllOccupied;
  if (updates_ > 0) refresh_threshold();
}

}  // namespace cloam
