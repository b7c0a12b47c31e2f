// Edits of a run's actors in the words that `cloam edit --actor` takes: [LOG:]ID:OPERATION,...
#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/runs/asset_maker.h"

namespace cloam {

/// replace=generated takes a new asset; replace=generated:7 one of a seed of its own.
constexpr char kGenerated[] = "generated";

class ActorEdits {
 public:
  /// The run must outlive this. Its looks as they are now are what replace=OTHER takes, so that two actors can be
  /// swapped. prior() names the run that makes assets; it is called when the first is asked for, and opens the device
  /// if need be. open() opens the device: replace=RUN:ID restores runs; without it there is no replace=RUN:ID.
  ActorEdits(StoredRun& run, std::function<std::filesystem::path()> prior, std::function<void()> open = {});
  /// Applies operations from left to right. Fault::usage for words that mean nothing here; those of the operations
  /// before stay applied then.
  void apply_all(const std::string& given, const MakerRequest& wish);

 private:
  ActorEdit parse(const std::string& operation, const AssetName& actor, const std::string& given,
                  const MakerRequest& wish);
  Replace generated(const AssetName& actor, const MakerRequest& wish);
  Replace adopted(const std::string& operand, const std::filesystem::path& folder);

  StoredRun& run_;
  std::function<std::filesystem::path()> prior_;
  std::function<void()> open_;
  const Scenes before_;
  std::vector<std::string> logs_;
  std::optional<AssetMaker> maker_;
  std::map<std::string, Replace> adopted_;  // by operand
};

}  // namespace cloam
