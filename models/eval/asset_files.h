// Assets that a run of diffusion generates, as files: latents, turntables, meshes, and a sheet of all.
#pragma once
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/latents/generates_assets.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"

namespace cloam {

/// The assets, the run whose street shows them, and how they were made.
struct GeneratedAssets {
  RestoredRun decoder;
  std::vector<NewAsset> assets;
  std::vector<AssetName> names;  // as the street knows them
  std::array<int64_t, 2> code_shape = {};
  nlohmann::ordered_json how;
};

/// Words for the record: the program's version, and what wish.codes is called.
struct MadeBy {
  std::string version, codes;
};

/// Fault::usage for a class or light that the prior never saw, Fault::data if the run that it learned from is gone.
GeneratedAssets generate_assets(const RestoredRun& prior, const AssetRequest& wish, const MadeBy& by);

struct AssetFiles {
  std::filesystem::path folder;
  bool pictures = false, meshes = true;
  int frames = 12, size = 128;  // of turntables, and their pixels
  int resolution = 96;          // of meshes: cells along the longest side
  std::filesystem::path grid() const;
};

/// Writes latents, turntables, meshes, the grid and generate.json, which is returned. Pictures of an earlier generation
/// in the folder are removed. Fault::write.
nlohmann::ordered_json write_assets(const GeneratedAssets& made, const AssetFiles& files, const Listener& listener);

}  // namespace cloam
