// See street_sweeps.h.
#include "models/street/street_sweeps.h"

#include <cstring>

#include "models/data/kept_sweeps.h"
#include "models/data/load_sweep.h"
#include "models/io/data_cache.h"
#include "models/io/in_parallel.h"

namespace cloam {
namespace {

/// Places of the sweeps that train.
std::vector<std::size_t> that_train(const Scene& scene) {
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < scene.sweeps.size(); ++i)
    if (scene.sweeps[i].split == Split::train) places.push_back(i);
  return places;
}

/// All that StreetSpace::look goes by.
std::string space_key(const Scene& scene, const StreetSpaceOptions& o, const std::vector<std::string>& sweep_keys) {
  CacheKey key("street-1");
  for (const float number : {o.voxel, o.along, o.sideways, o.below, o.above, o.sky}) key.add(number);
  key.add(o.dilate).add(scene.up);
  for (const std::string& sweep : sweep_keys) key.add(sweep);
  for (const Frame& frame : scene.frames)
    key.add(frame.world_from_camera).add(frame.camera).add(frame.split == Split::train);
  for (const Camera& camera : scene.cameras) {
    key.add(static_cast<int>(camera.model)).add(camera.width).add(camera.height);
    for (const double number : {camera.fx, camera.fy, camera.cx, camera.cy, camera.p1, camera.p2}) key.add(number);
    for (const double number : camera.k) key.add(number);
    for (const double number : camera.denominator) key.add(number);
    for (const double number : camera.prism) key.add(number);
  }
  for (const Actor& actor : scene.actors) {
    key.add(actor.size).add(actor.stationary).add(actor.boxes.size());
    for (const ActorBox& box : actor.boxes) key.add(box.step).add(box.timestamp).add(box.world_from_box);
  }
  return key.name();
}

/// Returns of each sweep, then what StreetSpace::kept says.
std::vector<std::uint8_t> entry_of(const std::vector<std::size_t>& returns, const StreetSpace& space) {
  const std::vector<std::uint8_t> voxels = space.kept();
  std::vector<std::uint8_t> bytes(8 * returns.size() + voxels.size());
  for (std::size_t i = 0; i < returns.size(); ++i) {
    const std::uint64_t count = returns[i];
    std::memcpy(&bytes[8 * i], &count, 8);
  }
  std::copy(voxels.begin(), voxels.end(), bytes.begin() + static_cast<std::ptrdiff_t>(8 * returns.size()));
  return bytes;
}

bool take_entry(std::span<const std::uint8_t> bytes, std::vector<std::size_t>& returns, StreetSpace& space) {
  if (bytes.size() < 8 * returns.size()) return false;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    std::uint64_t count = 0;
    std::memcpy(&count, &bytes[8 * i], 8);
    returns[i] = count;
  }
  return space.take(bytes.subspan(8 * returns.size()));
}

LogSweeps all_in_memory(const Scene& scene, StreetSpace& space) {
  std::vector<LoadedSweep> sweeps;
  for (const std::size_t place : that_train(scene))
    sweeps.push_back({&scene.sweeps[place], load_sweep(scene, scene.sweeps[place])});
  space.look(scene, sweeps);
  return sweeps;
}

/// Sweeps of the cache, with what finds them.
struct KeptSweeps {
  RestingScene scene;
  std::vector<std::size_t> places;  // among the scene's sweeps
  std::vector<std::string> keys;

  LidarPoints load(std::size_t i) const {
    if (auto kept = find_kept_sweep(keys[i])) return std::move(*kept);
    const std::shared_ptr<const Scene> now = scene.get();
    return load_kept_sweep(*now, now->sweeps[places[i]], keys[i]);
  }
};

}  // namespace

LogSweeps training_sweeps(const RestingScene& resting, StreetSpace& space, const std::shared_ptr<HostStore>& store) {
  const std::shared_ptr<const Scene> scene = resting.get();
  if (!store) return all_in_memory(*scene, space);
  KeptSweeps kept{resting, that_train(*scene), {}};
  kept.keys.resize(kept.places.size());
  std::vector<Sweep> sweeps;
  for (const std::size_t place : kept.places) sweeps.push_back(scene->sweeps[place]);
  in_parallel(sweeps.size(), [&](std::size_t i) { kept.keys[i] = sweep_key(*scene, sweeps[i]); });
  const std::string key = space_key(*scene, space.options(), kept.keys);
  std::vector<std::size_t> returns(sweeps.size());
  const auto entry = find_kept(key);
  if (!entry || !take_entry(*entry, returns, space)) {
    space.look(*scene, sweeps.size(), [&](std::size_t i, const SweepVisitor& visit) {
      const LidarPoints points = load_kept_sweep(*scene, sweeps[i], kept.keys[i]);
      returns[i] = points.size();
      visit(sweeps[i], points);
    });
    keep(key, entry_of(returns, space));
  }
  return {sweeps,
          returns,
          {store, sweeps.size(), [kept](std::size_t i) { return kept.load(i); },
           [returns](std::size_t i) { return sweep_bytes(returns[i]); }}};
}

}  // namespace cloam
