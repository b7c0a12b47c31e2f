// See generates_assets.h.
#include "models/latents/generates_assets.h"

#include <map>

namespace cloam {

std::vector<NewAsset> assets_like(GeneratesAssets& prior, CodeSource source, const std::vector<NewAsset>& like) {
  std::map<std::pair<int, bool>, int> counts;
  for (const NewAsset& asset : like) ++counts[{asset.asset_class, asset.night}];
  std::vector<NewAsset> assets;
  for (const auto& [kind, count] : counts) {
    AssetRequest wish;
    wish.count = count;
    wish.asset_class = kind.first;
    wish.night = kind.second;
    wish.seed = assets.size();  // noise of its own for each kind
    wish.codes = source;
    for (NewAsset& asset : prior.generate(wish)) assets.push_back(std::move(asset));
  }
  return assets;
}

}  // namespace cloam
