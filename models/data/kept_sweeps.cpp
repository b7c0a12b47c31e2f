// See kept_sweeps.h.
#include "models/data/kept_sweeps.h"

#include <cstring>

#include "models/data/load_sweep.h"
#include "models/io/bytes.h"
#include "models/io/data_cache.h"
#include "runtime/error.h"

namespace cloam {
namespace {

/// Every column of LidarPoints, and what was left out.
template <class Points, class Take>
void with_columns(Points& points, Take take) {
  take(points.positions, std::size_t{3});
  take(points.intensities, std::size_t{1});
  take(points.times, std::size_t{1});
  take(points.sensors, std::size_t{1});
}

std::vector<std::uint8_t> bytes_of(const LidarPoints& points) {
  const std::uint64_t head[] = {points.size(), points.dropped, points.of_ego};
  std::vector<std::uint8_t> bytes(sizeof head + sweep_bytes(points.size()));
  std::uint8_t* next = bytes.data();
  const auto put = [&](const void* from, std::size_t size) {
    std::memcpy(next, from, size);
    next += size;
  };
  put(head, sizeof head);
  with_columns(points, [&](const auto& column, std::size_t) { put(column.data(), column.size() * sizeof column[0]); });
  bytes.resize(static_cast<std::size_t>(next - bytes.data()));
  return bytes;
}

LidarPoints points_from(const std::vector<std::uint8_t>& bytes, const std::string& key) {
  ByteReader reader(bytes, key);
  LidarPoints points;
  const auto count = reader.little<std::uint64_t>("a count");
  points.dropped = reader.little<std::uint64_t>("a count");
  points.of_ego = reader.little<std::uint64_t>("a count");
  if (count > bytes.size()) bad_data(key, ": holds ", bytes.size(), " bytes, want those of ", count, " returns");
  with_columns(points, [&](auto& column, std::size_t each) {
    column.resize(count * each);
    const auto from = reader.take(column.size() * sizeof column[0], "returns");
    if (!column.empty()) std::memcpy(column.data(), from.data(), from.size());
  });
  return points;
}

}  // namespace

std::uint64_t sweep_bytes(std::size_t returns) {
  std::uint64_t bytes = 0;
  LidarPoints none;
  with_columns(
      none, [&](const auto& column, std::size_t each) { bytes += each * sizeof(column[0]) * std::uint64_t{returns}; });
  return bytes;
}

std::string sweep_key(const Scene& scene, const Sweep& sweep) {
  const auto add = [](CacheKey& key, const std::optional<Eigen::Vector3d>& vector) {
    key.add(vector.has_value()).add(vector.value_or(Eigen::Vector3d::Zero()));
  };
  CacheKey key("sweep-1");
  key.add(std::filesystem::path(sweep.file).extension().string()).add_file(scene.root / sweep.file);
  key.add(sweep.world_from_lidar).add(sweep.timestamp).add(sweep.points_in_world);
  add(key, sweep.velocity);
  add(key, sweep.second_lidar);
  const std::optional<CarBox>& car = scene.recording.car;
  add(key, car ? std::optional(car->centre) : std::nullopt);
  add(key, car ? std::optional(car->size) : std::nullopt);
  return key.name();
}

std::optional<LidarPoints> find_kept_sweep(const std::string& key) {
  const auto kept = find_kept(key);
  if (!kept) return std::nullopt;
  try {
    return points_from(*kept, key);
  } catch (const Error&) { return std::nullopt; }  // of a version that shares the name: read anew
}

LidarPoints load_kept_sweep(const Scene& scene, const Sweep& sweep, const std::string& key) {
  if (auto kept = find_kept_sweep(key)) return std::move(*kept);
  LidarPoints points = load_sweep(scene, sweep);
  keep(key, bytes_of(points));
  return points;
}

}  // namespace cloam
