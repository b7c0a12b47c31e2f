// The photos of a driving log that trains, with the actors of their times.
#pragma once
#include <vector>

#include "models/scene/actor_space.h"
#include "models/splat/initial_gaussians.h"

namespace cloam {

/// A photo's time is that of its frame.
struct TimedPhoto {
  PosedPhoto photo;
  double time = 0;
};

/// photos and scene must outlive it; room: of ActorSpace.
class StreetPhotos {
 public:
  StreetPhotos(const std::vector<TimedPhoto>& photos, const Scene& scene, const Eigen::Vector3d& room = kActorRoom)
      : spaces_(scene, {}, room) {
    for (const TimedPhoto& photo : photos) photos_.push_back({photo, spaces_.at(photo.time)});
  }
  struct One {
    const TimedPhoto& photo;
    const ActorSpace& actors;
  };
  const std::vector<One>& all() const { return photos_; }

 private:
  ActorSpaces spaces_;
  std::vector<One> photos_;
};

}  // namespace cloam
