// Generated assets for the actors of a run: who is replaced by what, for `edit` and `simulate`.
#pragma once
#include <filesystem>
#include <functional>
#include <string>

#include "models/runs/restore_run.h"
#include "models/scene/edit.h"

namespace cloam {

struct MakerRequest {
  uint64_t seed = 0;
  float guidance = 1;
  bool operator==(const MakerRequest&) const = default;
};

class AssetMaker {
 public:
  /// Restores the run in `prior`, which generates assets, for actors of `run`. Fault::usage if its method is none,
  /// Fault::data if it learned from codes that networks other than those of `run` decode.
  AssetMaker(const std::filesystem::path& prior, const StoredRun& run);

  /// A new asset of the actor's class and by the light of its log: of eight samples the one whose box is most like the
  /// actor's. It is added to run.generated; the edit that is returned makes the actor wear it. The same wish gives an
  /// actor the same asset, whoever else is replaced. Fault::usage for a class or light that the prior never saw.
  Replace make(StoredRun& run, const AssetName& actor, const MakerRequest& wish);

 private:
  RestoredRun prior_;
};

/// Gives every vehicle that is somewhere in the log a new asset; returns how many. Vehicles of a class that the prior
/// never saw stay as they are, which left_out(class, why) hears of each. Fault::data if none can be replaced.
std::size_t swap_vehicles(AssetMaker& maker, const MakerRequest& wish, int log, StoredRun& run,
                          const std::function<void(int asset_class, const std::string& why)>& left_out);

}  // namespace cloam
