// Actors of a run by name, and whose looks they have: in an edited run an actor may look like another one.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// Fault::internal if there is none: names that users gave were looked up before.
const Actor& actor_of(const Scenes& scenes, const AssetName& name);
Actor& actor_of(Scenes& scenes, const AssetName& name);

/// Whose looks the actor has: its own, or those that it was given.
AssetName appearance_of(const Scenes& scenes, const AssetName& name);

}  // namespace cloam
