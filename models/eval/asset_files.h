// Assets that a run of diffusion generates, as files: latents, turntables, meshes, and a sheet of all.
#pragma once
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/latents/generates_assets.h"
#include "models/runs/actor_names.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"
#include "models/train/ranks.h"

namespace cloam {

/// Words for the record: the program's version, and what wish.codes is called.
struct MadeBy {
  std::string version, codes;
};

/// Assets as a prior makes them, 64 at a time, and the run whose street shows those of now: memory does not grow with
/// the number that is wished for.
class Generation {
 public:
  static constexpr int kAtOnce = 64;

  /// Makes the first ones. `prior` must live as long as this. Fault::usage for a class or light that the prior never
  /// saw, Fault::data if the run that it learned from is gone.
  Generation(const RestoredRun& prior, const AssetRequest& wish, const MadeBy& by);
  /// Makes the next ones, in the place of those before; false (and none) at the end.
  bool next();

  Street& street() const { return street_of(decoder_); }
  Method& decoder() const { return *decoder_.method; }
  const std::vector<NewAsset>& assets() const { return assets_; }
  const std::vector<AssetName>& names() const { return names_; }  // as the street knows them
  /// How many there will be in all; of training codes at most so many.
  std::size_t wished() const { return static_cast<std::size_t>(wish_.count); }
  std::array<int64_t, 2> code_shape() const { return prior_.code_shape(); }
  const nlohmann::ordered_json& how() const { return how_; }

 private:
  GeneratesAssets& prior_;
  AssetRequest wish_, part_;  // all, and those of now
  RestoredRun decoder_;
  std::vector<NewAsset> assets_;
  std::vector<AssetName> names_;
  nlohmann::ordered_json how_;
};

struct AssetFiles {
  std::filesystem::path folder;
  bool pictures = false, meshes = true;
  int frames = 12, size = 128;  // of turntables, and their pixels
  int resolution = 96;          // of meshes: cells along the longest side
  std::filesystem::path grid() const;
};

/// Writes turntables, meshes, the grid (of the first 256), latents and generate.json, which is returned. Pictures of an
/// earlier generation in the folder are removed. Ranks share the assets; the first writes what is of all. Fault::write.
nlohmann::ordered_json write_assets(Generation& made, const AssetFiles& files, const Listener& listener,
                                    const Ranks& ranks = alone());

}  // namespace cloam
