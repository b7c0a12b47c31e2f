// Where a training of gaussians of a driving log begins: points that LiDAR saw, those of actors in their boxes.
#pragma once
#include <functional>

#include "models/data/load_sweep.h"
#include "models/scene/pixels.h"
#include "models/splat/initial_gaussians.h"
#include "models/splat/street_photos.h"

namespace cloam {

/// Calls its argument for every sweep that trains, one after the other.
using EverySweep = std::function<void(const std::function<void(const Sweep& sweep, const LidarPoints& points)>& visit)>;

struct StreetStartOptions {
  int lidar = 800000;               // points outside of boxes, at most
  float voxel = 0.15f;              // metres: of these, one each
  int near = 100000, far = 100000;  // points above the ground that are drawn: as far as LiDAR sees, and beyond
  int actor = 5000;                 // points of one actor, at most
  int fewest = 1000;                // with fewer, more are drawn in its box
  int64_t actors = 300000;          // points of all actors, at most, if `fewest` of each are no more
  uint64_t seed = 0;
  bool ground = true;  // that of hidden_ground.h
};

/// Grey. Actors' are in the axes of their boxes, the actors' one after the other.
struct StreetStart {
  Gaussians background, actors;
  std::vector<int32_t> owners;  // of `actors`: place in Scene::actors
  std::size_t seen = 0;         // of `background`: the first so many are where LiDAR saw something
};

/// Fault::data where there is no point at all.
StreetStart street_start(const Scene& scene, const EverySweep& every_sweep, StreetStartOptions options);

/// Each Gaussian takes the colour of its pixel in the photo that shows its mean from nearest by, with no other actor's
/// box before it; where none does, the mean colour of the others: of the background, of its actor, or of all actors
/// where no photo shows its own.
void colour_street(const std::vector<TimedPhoto>& photos, const Scene& scene, StreetStart& start);

}  // namespace cloam
