// Generated assets on disk: what `generate` writes, and what an edited run holds of those that its actors wear.
#pragma once
#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "models/train/street.h"

namespace cloam {

struct NewAssets {
  std::vector<NewAsset> assets;
  std::array<int64_t, 2> shape{};           // channels and side of their codes
  std::map<std::string, std::string> made;  // how they were made, in words
};

/// As docs/formats.md says of latents.safetensors. Equal assets give equal bytes. Fault::write.
void write_new_assets(const std::filesystem::path& path, const NewAssets& assets);

/// Sizes are as float32 holds them. Fault::data for what is missing, does not fit together or can be no asset.
NewAssets read_new_assets(const std::filesystem::path& path);

}  // namespace cloam
