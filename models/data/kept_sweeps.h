// LiDAR sweeps that were read once: as bytes of the data cache, which are read a hundred times as fast as the pickles
// that logs have.
#pragma once
#include <optional>
#include <string>

#include "models/scene/lidar_points.h"
#include "models/scene/scene.h"

namespace cloam {

/// The entry of the data cache: by the bytes of the sweep's file and everything that the scene says of the sweep.
/// Fault::data if the file cannot be read.
std::string sweep_key(const Scene& scene, const Sweep& sweep);

/// What the cache has under the key; none: nothing that can be read. Thread-safe.
std::optional<LidarPoints> find_kept_sweep(const std::string& key);
/// As load_sweep, from the cache where it has the entry; else it has it afterwards. Thread-safe.
LidarPoints load_kept_sweep(const Scene& scene, const Sweep& sweep, const std::string& key);

/// Bytes that the points of so many returns take in memory.
std::uint64_t sweep_bytes(std::size_t returns);

}  // namespace cloam
