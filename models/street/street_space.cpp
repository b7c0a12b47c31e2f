// See street_space.h.
#include "models/street/street_space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

#include "models/io/gzip.h"
#include "models/io/in_parallel.h"
#include "models/io/tensors.h"
#include "models/scene/actor_space.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kBlock = 8;            // voxels a side of StreetGrid::blocks
constexpr double kUpperEdge = 0.02;  // share of a sweep's points that are its upper edge
constexpr double kMiddle = 0.02;     // share of the points on either side that is not of the middle
constexpr double kBlindRise = 3;     // metres that a wall goes on above LiDARs' sight where no camera looks: a storey
constexpr int64_t kMaxCells = 1 << 26;

using Points = std::vector<Eigen::Vector3d>;

/// Right-handed axes: z up, x along the way from the first camera's place to the one furthest from it; where they
/// stand, along the first camera's sight.
Eigen::Matrix3d axes_of(const Scene& scene) {
  const Eigen::Vector3d up = scene.up.normalized();
  const Frame& first = scene.frames.front();
  Eigen::Vector3d way = Eigen::Vector3d::Zero();
  for (const Frame& frame : scene.frames) {
    const Eigen::Vector3d other = frame.position() - first.position();
    if (other.norm() > way.norm()) way = other;
  }
  way -= up * way.dot(up);
  if (way.norm() < 1) way = first.world_from_camera.block<3, 1>(0, 2), way -= up * way.dot(up);
  if (way.norm() < 1e-6) way = up.unitOrthogonal();
  Eigen::Matrix3d axes;
  axes.row(0) = way.normalized();
  axes.row(2) = up;
  axes.row(1) = up.cross(way.normalized());
  return axes;
}

/// Moves the values about.
double quantile(std::vector<double>& values, double share) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

struct Static {
  Points points, tops;  // street axes; tops: of them those at the upper edge of the LiDAR's sight
};

struct SeenSweep {
  const Sweep& sweep;
  const LidarPoints& points;
};

void add_sweep(const Scene& scene, const SeenSweep& seen, const Eigen::Matrix4d& street_from_world, Static& out) {
  const auto& [sweep, points] = seen;
  ActorSpaces actors(scene);
  const Eigen::Vector3d up = scene.up.normalized();
  std::vector<double> elevations;
  Points kept;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float* p = &points.positions[3 * i];
    const SeenFrom from = seen_from(sweep, points, i);
    const Eigen::Vector3d world(p[0], p[1], p[2]), way = world - from.origin;
    if (way.norm() < 1e-3 || actors.at(from.time).holds(world)) continue;
    kept.push_back((street_from_world * world.homogeneous()).head<3>());
    elevations.push_back(way.dot(up) / way.norm());
  }
  if (kept.empty()) return;
  std::vector<double> sorted = elevations;
  const double edge = quantile(sorted, 1 - kUpperEdge);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    out.points.push_back(kept[i]);
    if (elevations[i] >= edge) out.tops.push_back(kept[i]);
  }
}

}  // namespace

Tensor contracted(const Tensor& points, const StreetGrid& grid) {
  const auto numbers = [&](int64_t begin, int64_t count) {
    return reshape(slice(grid.numbers, 0, begin, begin + count), {1, count});
  };
  const Tensor x = (points - numbers(7, 3)) / numbers(10, 3), norm = maximum(max(abs(x), {{1}, true}), 1.f);
  return x * ((2.f - 1.f / norm) / norm) * 0.25f + 0.5f;
}

StreetSpace::StreetSpace(const Scene& scene, const StreetSpaceOptions& options) : options_(options) {
  const Eigen::Matrix3d axes = axes_of(scene);
  Bounds track{Eigen::Vector3d::Constant(1e30), Eigen::Vector3d::Constant(-1e30)};
  for (const Frame& frame : scene.frames) {
    const Eigen::Vector3d p = axes * frame.position();
    track.low = track.low.cwiseMin(p);
    track.high = track.high.cwiseMax(p);
  }
  const Eigen::Vector3d middle = (track.low + track.high) / 2;
  street_from_world_.topLeftCorner<3, 3>() = axes;
  street_from_world_.topRightCorner<3, 1>() = -middle;
  track_ = {track.low - middle, track.high - middle};
  const Bounds all = reach();
  lay(all, {all.low / 2, all.high / 2});
}

/// What counts around the track.
StreetSpace::Bounds StreetSpace::reach() const {
  const Eigen::Vector3d low(options_.along, options_.sideways, options_.below),
      high(options_.along, options_.sideways, options_.above);
  return {track_.low - low, track_.high + high};
}

std::array<int, 3> StreetSpace::counts() const {
  return {static_cast<int>(numbers_[4]), static_cast<int>(numbers_[5]), static_cast<int>(numbers_[6])};
}

/// The grid's numbers. What is not contracted is the middle.
void StreetSpace::lay(const Bounds& grid, const Bounds& middle) {
  double voxel = options_.voxel;
  const Eigen::Vector3d size = (grid.high - grid.low).cwiseMax(voxel);
  while ((size / voxel).array().ceil().prod() > static_cast<double>(kMaxCells)) voxel *= 1.25;
  numbers_ = {};
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    numbers_[at] = static_cast<float>(grid.low[axis]);
    numbers_[4 + at] = static_cast<float>(std::ceil(size[axis] / voxel));
    numbers_[7 + at] = static_cast<float>((middle.low[axis] + middle.high[axis]) / 2);
    numbers_[10 + at] = static_cast<float>(std::max(1.0, (middle.high[axis] - middle.low[axis]) / 2));
  }
  numbers_[3] = static_cast<float>(voxel);
  numbers_[13] = options_.sky;
}

namespace {

/// The place of a voxel among the cells, or nothing outside.
struct Voxels {
  const std::array<float, 16>& numbers;
  std::array<int, 3> counts;
  std::optional<std::array<int, 3>> at(const Eigen::Vector3d& p) const {
    std::array<int, 3> c{};
    for (std::size_t k = 0; k < 3; ++k) {
      const double x = std::floor((p[static_cast<Eigen::Index>(k)] - double{numbers[k]}) / double{numbers[3]});
      if (x < 0 || x >= counts[k]) return std::nullopt;
      c[k] = static_cast<int>(x);
    }
    return c;
  }
  Eigen::Vector3d middle(int x, int y, int z) const {
    return Eigen::Vector3d(numbers[0], numbers[1], numbers[2]) +
           Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5) * double{numbers[3]};
  }
  std::size_t place(int x, int y, int z) const {
    return (std::size_t(z) * std::size_t(counts[1]) + std::size_t(y)) * std::size_t(counts[0]) + std::size_t(x);
  }
};

/// Those of training images.
class Cameras {
 public:
  Cameras(const Scene& scene, const Eigen::Matrix4d& street_from_world) : scene_(scene) {
    for (const Frame& frame : scene.frames)
      if (frame.split == Split::train)
        views_.push_back({frame.camera, (street_from_world * frame.world_from_camera).inverse()});
  }
  /// Does the point (street axes) lie in any of the images? `likely`: the place of the image that is asked first, then
  /// that of the one which sees it: neighbouring points mostly lie in one image.
  bool see(const Eigen::Vector3d& point, std::size_t& likely) const {
    if (likely < views_.size() && sees(views_[likely], point)) return true;
    const auto found = std::find_if(views_.begin(), views_.end(), [&](const View& view) { return sees(view, point); });
    likely = static_cast<std::size_t>(found - views_.begin());
    return found != views_.end();
  }

 private:
  struct View {
    int camera;
    Eigen::Matrix4d camera_from_street;
  };

  bool sees(const View& view, const Eigen::Vector3d& point) const {
    const Eigen::Vector3d p = (view.camera_from_street * point.homogeneous()).head<3>();
    if (p.z() <= 0) return false;
    const Camera& camera = scene_.cameras[static_cast<std::size_t>(view.camera)];
    const Eigen::Vector2d at = project(camera, p);
    return at.x() >= 0 && at.y() >= 0 && at.x() < camera.width && at.y() < camera.height;
  }

  const Scene& scene_;
  std::vector<View> views_;
};

}  // namespace

void StreetSpace::mark(const Points& points) {
  const Voxels voxels{numbers_, counts()};
  for (const Eigen::Vector3d& p : points)
    if (const auto c = voxels.at(p)) cells_[voxels.place((*c)[0], (*c)[1], (*c)[2])] = 1;
}

/// As far as cameras look: above what LiDARs see, they alone can tell matter from air. Elsewhere a storey is a guess.
void StreetSpace::raise(const Points& tops, const Scene& scene) {
  const Voxels voxels{numbers_, counts()};
  const Cameras cameras(scene, street_from_world_);
  std::map<std::pair<int, int>, int> lowest;  // top of each column
  for (const Eigen::Vector3d& p : tops)
    if (const auto c = voxels.at(p)) {
      const auto [top, fresh] = lowest.insert({{(*c)[0], (*c)[1]}, (*c)[2]});
      if (!fresh) top->second = std::min(top->second, (*c)[2]);
    }
  const int blind = static_cast<int>(kBlindRise / double{numbers_[3]});
  const std::vector<std::pair<std::pair<int, int>, int>> columns(lowest.begin(), lowest.end());
  in_parallel(columns.size(), [&](std::size_t i) {
    const auto& [column, top] = columns[i];
    std::size_t likely = 0;
    for (int z = top; z < voxels.counts[2]; ++z)
      if (z <= top + blind || cameras.see(voxels.middle(column.first, column.second, z), likely))
        cells_[voxels.place(column.first, column.second, z)] = 1;
  });
}

/// Along one axis after the other: a cube around every occupied voxel.
void StreetSpace::dilate() {
  const Voxels voxels{numbers_, counts()};
  const std::array<int, 3> n = voxels.counts;
  for (int axis = 0; axis < 3; ++axis) {
    const std::vector<uint8_t> before = cells_;
    const std::size_t stride = voxels.place(axis == 0, axis == 1, axis == 2);
    for (int z = 0; z < n[2]; ++z)
      for (int y = 0; y < n[1]; ++y)
        for (int x = 0; x < n[0]; ++x) {
          const std::size_t here = voxels.place(x, y, z);
          if (!before[here]) continue;
          const int place = axis == 0 ? x : axis == 1 ? y : z;
          for (int by = 1; by <= options_.dilate; ++by) {
            if (place - by >= 0) cells_[here - std::size_t(by) * stride] = 1;
            if (place + by < n[std::size_t(axis)]) cells_[here + std::size_t(by) * stride] = 1;
          }
        }
  }
}

void StreetSpace::look(const Scene& scene, const std::vector<LoadedSweep>& sweeps) {
  look(scene, sweeps.size(),
       [&](std::size_t i, const SweepVisitor& visit) { visit(*sweeps[i].sweep, sweeps[i].points); });
}

void StreetSpace::look(const Scene& scene, std::size_t sweeps,
                       const std::function<void(std::size_t number, const SweepVisitor& visit)>& with_sweep) {
  std::vector<Static> seen(sweeps);  // by sweep
  in_parallel(sweeps, [&](std::size_t i) {
    with_sweep(i, [&](const Sweep& sweep, const LidarPoints& points) {
      add_sweep(scene, {sweep, points}, street_from_world_, seen[i]);
    });
  });
  std::size_t count = 0;
  for (const Static& part : seen) count += part.points.size();
  if (count == 0) return;
  Bounds all = reach(), middle;
  in_parallel(3, [&](std::size_t k) {
    const auto axis = static_cast<Eigen::Index>(k);
    std::vector<double> values;
    values.reserve(count);
    for (const Static& part : seen)
      for (const Eigen::Vector3d& p : part.points) values.push_back(p[axis]);
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    all.low[axis] = std::max(all.low[axis], *least - 1);
    if (axis < 2) all.high[axis] = std::min(all.high[axis], *most + 1);
    middle.low[axis] = std::max(all.low[axis], quantile(values, kMiddle));
    middle.high[axis] = std::min(all.high[axis], quantile(values, 1 - kMiddle));
  });
  lay(all, middle);
  cells_.assign(cell_count(), 0);
  Points tops;
  for (const Static& part : seen) {
    mark(part.points);
    tops.insert(tops.end(), part.tops.begin(), part.tops.end());
  }
  raise(tops, scene);
  dilate();
  pack();
}

std::size_t StreetSpace::cell_count() const {
  const std::array<int, 3> n = counts();
  return std::size_t(n[0]) * std::size_t(n[1]) * std::size_t(n[2]);
}

/// cells_, which are empty afterwards.
void StreetSpace::pack() {
  std::vector<uint8_t> bits((cells_.size() + 7) / 8, 0);
  for (std::size_t i = 0; i < cells_.size(); ++i) bits[i / 8] |= static_cast<uint8_t>(cells_[i] << (i % 8));
  packed_ = gzip(bits);
  packed_.shrink_to_fit();
  cells_ = {};
  rest();
}

/// Eight cells a byte.
std::vector<uint8_t> StreetSpace::bits() const {
  const std::size_t count = cell_count();
  if (!packed_.empty()) return gunzip(packed_, (count + 7) / 8, "the voxels of a street");
  std::vector<uint8_t> all((count + 7) / 8, 0xff);
  if (count % 8 != 0) all.back() = static_cast<uint8_t>((1 << count % 8) - 1);
  return all;
}

uint64_t StreetSpace::unpacked_bytes() const { return cell_count() + cell_count() / 64; }

StreetCells StreetSpace::unpacked() const {
  StreetCells out{counts(), {}, {}, {}};
  const std::array<int, 3>& n = out.counts;
  std::array<int, 3>& b = out.block_counts;
  for (std::size_t k = 0; k < 3; ++k) b[k] = (n[k] + kBlock - 1) / kBlock;
  const std::vector<uint8_t> packed = bits();
  out.cells.resize(cell_count());
  out.blocks.resize(std::size_t(b[0]) * std::size_t(b[1]) * std::size_t(b[2]));
  std::size_t place = 0;
  for (int z = 0; z < n[2]; ++z)
    for (int y = 0; y < n[1]; ++y)
      for (int x = 0; x < n[0]; ++x, ++place) {
        if (!(packed[place / 8] >> (place % 8) & 1)) continue;
        out.cells[place] = 1;
        out.blocks[(std::size_t(z / kBlock) * std::size_t(b[1]) + std::size_t(y / kBlock)) * std::size_t(b[0]) +
                   std::size_t(x / kBlock)] = 1;
      }
  return out;
}

void StreetSpace::show(const StreetCells& cells) const {
  const std::array<int, 3>&n = cells.counts, &b = cells.block_counts;
  grid_.cells = from_host(cells.cells, {n[2], n[1], n[0]});
  grid_.blocks = from_host(cells.blocks, {b[2], b[1], b[0]});
  grid_.numbers = from_host(std::vector<float>(numbers_.begin(), numbers_.end()), {16});
}

const StreetGrid& StreetSpace::grid() const {
  if (!is_shown()) show(unpacked());
  return grid_;
}

std::vector<uint8_t> StreetSpace::kept() const {
  std::vector<uint8_t> bytes(sizeof numbers_ + packed_.size());
  std::memcpy(bytes.data(), numbers_.data(), sizeof numbers_);
  std::copy(packed_.begin(), packed_.end(), bytes.begin() + sizeof numbers_);
  return bytes;
}

bool StreetSpace::take(std::span<const uint8_t> bytes) {
  if (bytes.size() < sizeof numbers_) return false;
  std::memcpy(numbers_.data(), bytes.data(), sizeof numbers_);
  packed_.assign(bytes.begin() + sizeof numbers_, bytes.end());
  rest();
  return true;
}

TensorMap StreetSpace::state() const {
  const std::vector<uint8_t> packed = bits();
  NamedTensor cells{"U8", {static_cast<int64_t>(packed.size())}, std::vector<std::byte>(packed.size())};
  std::memcpy(cells.data.data(), packed.data(), packed.size());
  return {{"cells", std::move(cells)},
          {"numbers", named_floats(std::vector<float>(numbers_.begin(), numbers_.end()), {16})}};
}

void StreetSpace::restore(const TensorMap& state) {
  const std::vector<float> numbers = tensor_from(state, "numbers", {16}).to_host();
  double cells = 1;
  for (std::size_t k = 4; k < 7; ++k) cells *= numbers[k] >= 1 ? std::floor(numbers[k]) : std::nan("");
  if (!(cells <= static_cast<double>(kMaxCells)) || !(numbers[3] > 0))
    throw Error(Fault::data, text("the checkpoint's grid has ", cells, " voxels of ", numbers[3], " m"));
  std::copy(numbers.begin(), numbers.end(), numbers_.begin());
  const auto count = static_cast<int64_t>(cells);
  packed_ = gzip(tensor_from(state, "cells", {(count + 7) / 8}).to_host<uint8_t>());
  rest();
}

}  // namespace cloam
