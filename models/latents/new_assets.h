// Generated assets, and how they lie on disk: what `generate` writes, and what an edited run holds of those that its
// actors wear.
#pragma once
#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// An asset that no log of the run shows: its latent code, of the shape that the run's own have, and the box that it
/// fills.
struct NewAsset {
  int asset_class = 0;  // of kAssetClasses
  bool night = false;   // what it was asked to look like
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  std::vector<float> code;  // [channels, side, side]
};

/// The name of the n-th asset (from 0) that a street of so many logs is given.
inline AssetName added_asset(std::size_t logs, std::size_t n) { return {static_cast<int>(logs + n), "generated"}; }

struct NewAssets {
  std::vector<NewAsset> assets;
  std::array<int64_t, 2> shape{};           // channels and side of their codes
  std::map<std::string, std::string> made;  // how they were made, in words
};

/// The file of assets that come one by one: of each that was added it keeps the numbers of the file.
class AssetArrays {
 public:
  explicit AssetArrays(const std::array<int64_t, 2>& shape) : shape_(shape) {}
  void add(const NewAsset& asset);
  /// As docs/formats.md says of latents.safetensors. Equal assets give equal bytes. Fault::write.
  void write(const std::filesystem::path& path, const std::map<std::string, std::string>& made) const;

 private:
  std::array<int64_t, 2> shape_;
  std::vector<float> latents_, sizes_;
  std::vector<int64_t> classes_, nights_;
};

/// The same of assets that are at hand.
void write_new_assets(const std::filesystem::path& path, const NewAssets& assets);

/// Sizes are as float32 holds them. Fault::data for what is missing, does not fit together or can be no asset.
NewAssets read_new_assets(const std::filesystem::path& path);

}  // namespace cloam
