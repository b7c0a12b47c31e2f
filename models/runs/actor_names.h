// Actors of a run as the user names them: [LOG:]ID, where ID may be the beginning, or else any part, of an id that no
// other actor's has.
#pragma once
#include <string>
#include <vector>

#include "models/runs/restore_run.h"
#include "models/scene/assets.h"
#include "models/street/street.h"

namespace cloam {

/// One name a scene: its number from 0 and the name of its folder both name a log.
std::vector<std::string> log_names(const RunRecord& record);

/// "0", "01f3" or "1:01f3". Fault::usage with the nearest names for what fits no actor or several.
AssetName find_actor(const Scenes& scenes, const std::vector<std::string>& logs, const std::string& word);

/// The number of a log given as number or name. Fault::usage with the names there are.
int find_log(const std::vector<std::string>& logs, const std::string& word);

/// As find_actor takes it: with the log's number in front where there are several logs.
std::string spelled(const Scenes& scenes, const AssetName& name);

/// The label of what an actor looks like: that of the actor whose appearance it has. A generated asset has the label of
/// its wearer, if that is of the asset's class.
std::string seen_label(const StoredRun& run, const AssetName& actor);

/// Of classes (kAssetClasses) from cars to motorcycles.
bool is_vehicle(int asset_class);

/// The run's street. Fault::usage for a method that knows no actors.
Street& street_of(const RestoredRun& run);

/// The shortest beginning, of four letters or more, by which find_actor knows the actor; with its log as spelled() has
/// it.
std::string short_id(const Scenes& scenes, const AssetName& name);

}  // namespace cloam
