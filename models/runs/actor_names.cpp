// See actor_names.h.
#include "models/runs/actor_names.h"

#include <algorithm>
#include <filesystem>

#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kMaxShown = 6;

std::vector<AssetName> all_actors(const Scenes& scenes) {
  std::vector<AssetName> names;
  for (std::size_t scene = 0; scene < scenes.size(); ++scene) {
    for (const Actor& actor : scenes[scene].actors) names.push_back({static_cast<int>(scene), actor.id});
  }
  return names;
}

std::string list(const Scenes& scenes, const std::vector<AssetName>& names) {
  std::vector<std::string> shown;
  for (const AssetName& name : names)
    if (shown.size() < kMaxShown) shown.push_back(spelled(scenes, name));
  return joined(shown) + (names.size() > kMaxShown ? ", ..." : "");
}

[[noreturn]] void no_actor(const Scenes& scenes, const std::vector<AssetName>& all, const std::string& word,
                           const std::string& id) {
  // Ids are long and differ from their first letters on: what is compared is the beginning that was typed.
  std::vector<std::string> beginnings;
  for (const AssetName& name : all) beginnings.push_back(name.actor_id.substr(0, id.size()));
  const std::string nearest = nearest_name(id, beginnings);
  std::vector<AssetName> near;
  for (const AssetName& name : all) {
    if (!nearest.empty() && name.actor_id.starts_with(nearest)) near.push_back(name);
  }
  const std::string hint = near.empty() ? text("; there are ", all.size(), ": ", list(scenes, all))
                                        : "; did you mean " + list(scenes, near) + "?";
  throw Error(Fault::usage, text("there is no actor ", word, hint, "\n  cloam edit RUN --list shows all"));
}

}  // namespace

std::vector<std::string> log_names(const RunRecord& record) {
  std::vector<std::string> names;
  for (const RunData& data : record.data) {
    const std::filesystem::path path = std::filesystem::path(data.given).lexically_normal();
    names.push_back((path.has_filename() ? path : path.parent_path()).filename().string());
  }
  return names;
}

int find_log(const std::vector<std::string>& logs, const std::string& word) {
  for (std::size_t i = 0; i < logs.size(); ++i) {
    if (word == std::to_string(i)) return static_cast<int>(i);
  }
  if (std::count(logs.begin(), logs.end(), word) == 1) {
    return static_cast<int>(std::find(logs.begin(), logs.end(), word) - logs.begin());
  }
  std::vector<std::string> known;
  for (const std::string& log : logs) known.push_back(text(known.size(), " (", log, ")"));
  throw Error(Fault::usage,
              text("the run has no log ", word, "; its logs are ", joined(known), did_you_mean(word, logs)));
}

AssetName find_actor(const Scenes& scenes, const std::vector<std::string>& logs, const std::string& word) {
  std::vector<AssetName> all = all_actors(scenes);
  const std::size_t colon = word.find(':');
  const std::string id = colon == std::string::npos ? word : word.substr(colon + 1);
  if (colon != std::string::npos) {
    const int log = find_log(logs, word.substr(0, colon));
    std::erase_if(all, [&](const AssetName& name) { return name.scene != log; });
  }
  std::vector<AssetName> whole, begun, with;
  for (const AssetName& name : all) {
    if (name.actor_id == id) whole.push_back(name);
    if (!id.empty() && name.actor_id.starts_with(id)) begun.push_back(name);
    if (!id.empty() && name.actor_id.find(id) != std::string::npos) with.push_back(name);
  }
  const std::vector<AssetName>& found = !whole.empty() ? whole : !begun.empty() ? begun : with;
  if (found.empty()) no_actor(scenes, all, word, id);
  if (found.size() == 1) return found.front();
  throw Error(Fault::usage, text("'", word, "' matches ", found.size(), " actors: ", list(scenes, found),
                                 "; give more of the id", scenes.size() > 1 ? ", or name its log (LOG:ID)" : ""));
}

std::string spelled(const Scenes& scenes, const AssetName& name) {
  return scenes.size() > 1 ? text(name.scene, ":", name.actor_id) : name.actor_id;
}

std::string short_id(const Scenes& scenes, const AssetName& name) {
  constexpr std::size_t kLeast = 4;
  const std::string& id = name.actor_id;
  const std::vector<Actor>& actors = scenes[static_cast<std::size_t>(name.scene)].actors;
  const auto is_enough = [&](std::size_t length) {
    const bool cuts_letter = (static_cast<unsigned char>(id[length]) & 0xC0) == 0x80;  // within UTF-8
    const std::string beginning = id.substr(0, length);
    return !cuts_letter && std::count_if(actors.begin(), actors.end(),
                                         [&](const Actor& actor) { return actor.id.starts_with(beginning); }) == 1;
  };
  std::size_t length = std::min(kLeast, id.size());
  while (length < id.size() && !is_enough(length)) ++length;
  return spelled(scenes, {name.scene, id.substr(0, length)});
}

std::string seen_label(const StoredRun& run, const AssetName& name) {
  const AssetName appearance = appearance_of(run.scenes, name);
  const auto scene = static_cast<std::size_t>(appearance.scene);
  if (scene < run.scenes.size()) return actor_of(run.scenes, appearance).label;
  const int worn = run.generated.assets.at(scene - run.scenes.size()).asset_class;
  const std::string& own = actor_of(run.scenes, name).label;
  return asset_class(own) == worn ? own : kAssetClasses[worn];
}

bool is_vehicle(int asset_class) {
  constexpr int kMotorcycle = 6;
  return asset_class <= kMotorcycle;
}

Street& street_of(const RestoredRun& run) { return require<Street>(*run.method, run.record.method, "this command"); }

}  // namespace cloam
