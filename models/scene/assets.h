// Actors of a run by name, and whose looks they have: in an edited run an actor may look like another one.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// Fault::internal if there is none: names that users gave were looked up before.
const Actor& actor_of(const Scenes& scenes, const AssetName& name);
Actor& actor_of(Scenes& scenes, const AssetName& name);

/// Actors of Table A1's classes stay; things of other labels (cones, signs) become part of the background.
void keep_road_users(Scene& scene);

/// Whose looks the actor has: its own, or those that it was given.
AssetName appearance_of(const Scenes& scenes, const AssetName& name);

}  // namespace cloam
