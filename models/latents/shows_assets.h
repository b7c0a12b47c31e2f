// Capability: shows assets that no log of the run has, from their codes.
#pragma once
#include "models/latents/new_assets.h"

namespace cloam {

class ShowsAssets {
 public:
  virtual ~ShowsAssets() = default;
  /// The assets that can be shown from here on, in the place of those before; their names are added_asset(logs, place).
  /// Actors that have such an appearance wear it. Fault::usage for a run whose assets have no codes, Fault::data for a
  /// code of another size.
  virtual std::vector<AssetName> show_assets(const std::vector<NewAsset>& assets) = 0;
};

}  // namespace cloam
