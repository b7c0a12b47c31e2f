// See assets.h.
#include "models/scene/assets.h"

#include <algorithm>
#include <utility>

#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {

const Actor& actor_of(const Scenes& scenes, const AssetName& name) {
  const std::vector<Actor>& actors = scenes.at(static_cast<std::size_t>(name.scene)).actors;
  const auto found = std::find_if(actors.begin(), actors.end(), [&](const Actor& a) { return a.id == name.actor_id; });
  if (found == actors.end()) throw Error(Fault::internal, text("scene ", name.scene, " has no actor ", name.actor_id));
  return *found;
}

Actor& actor_of(Scenes& scenes, const AssetName& name) {
  return const_cast<Actor&>(actor_of(std::as_const(scenes), name));
}

void keep_road_users(Scene& scene) {
  scene.other_actors +=
      std::erase_if(scene.actors, [](const Actor& actor) { return asset_class(actor.label) == kAssetClassCount - 1; });
}

AssetName appearance_of(const Scenes& scenes, const AssetName& name) {
  return actor_of(scenes, name).asset.value_or(name);
}

}  // namespace cloam
