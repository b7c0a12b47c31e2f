// The edits that pages make: each becomes words of `cloam edit --actor`, so that what is saved is what edit writes.
#pragma once
#include <map>
#include <set>
#include <string>
#include <vector>

#include "models/io/json.h"
#include "models/runs/actor_edits.h"

namespace cloam {

class ViewEdits {
 public:
  /// The run must outlive this; it is what is edited. `prior` as typed, "" for none, and as ActorEdits takes it.
  ViewEdits(StoredRun& run, std::string prior, std::function<std::filesystem::path()> find_prior);
  /// An edit as docs/viewer.md has it. The run stays as it was if it throws. Fault::usage, Fault::data.
  void apply(const Json& request);
  bool can_undo() const { return !history_.empty(); }
  bool can_save() const { return !now_.words.empty(); }
  /// Refused (409) where there is nothing to undo.
  void undo();
  bool hides(const AssetName& actor) const { return now_.hidden.contains(key_of(actor)); }
  /// The boxes that a hidden actor had.
  Actor shown(const AssetName& actor) const;
  /// The words of the command that writes the run into `folder`.
  std::vector<std::string> command(const std::string& folder) const;
  /// Writes it. Refused (400) for a name that is none, Refused (409) for a folder that holds something other than a run
  /// that this wrote.
  void save(const std::string& folder);

 private:
  using Key = std::pair<int, std::string>;
  struct State {
    std::vector<std::vector<Actor>> actors;  // of each scene
    NewAssets generated;
    std::vector<std::string> words;               // [LOG:]ID:OPERATION
    std::map<Key, std::vector<ActorBox>> hidden;  // the boxes that they had
  };
  static Key key_of(const AssetName& name) { return {name.scene, name.actor_id}; }
  State state() const;
  void restore(const State& state);
  void show(const AssetName& actor, const std::string& word);
  std::string operation(const Json& request, const AssetName& actor) const;

  StoredRun& run_;
  std::string prior_;
  ActorEdits edits_;
  std::vector<std::string> logs_;
  State now_;  // words and what is hidden; the rest lies in the run
  std::vector<State> history_;
  std::set<std::filesystem::path> saved_;
};

}  // namespace cloam
