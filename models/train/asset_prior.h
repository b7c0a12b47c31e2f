// What methods can do that learn which assets there are: their data are the assets of a trained run, not captures.
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/diffusion/guidance.h"
#include "models/scene/asset_class.h"
#include "models/train/street.h"

namespace cloam {

struct StoredRun;
struct RunRecord;

/// How well noise is told from assets that were held out. v-loss: mean squared error of v (schedule.h).
struct PriorScore {
  int64_t codes = 0, training_codes = 0;
  double v_loss = 0, zero_v_loss = 0;  // on the codes held out; of predicting zero
  double floor_v_loss = 0;             // of knowing each of their means: what codes draw of their own nobody foretells
  double training_v_loss = 0;
};

/// Where codes come from: samples of the network, a standard normal distribution instead of it (what the network must
/// beat), or the codes that it was trained on, as they are.
enum class CodeSource { sampled, random, training };

struct AssetWish {
  int count = 1;                   // of training codes: at most
  std::optional<int> asset_class;  // of kAssetClasses; none: as often as in training
  std::optional<bool> night;       // none: as often as in training, of that class
  uint64_t seed = 0;
  float guidance = 1;
  int steps = 50;
  CodeSource codes = CodeSource::sampled;
};

class AssetPrior {
 public:
  virtual ~AssetPrior() = default;
  /// The settings that follow from the run to learn from. Fault::data for a run that has no assets to learn from.
  virtual std::map<std::string, std::string> settings_from(const RunRecord& source) const = 0;
  /// After build: takes the run's assets. Fault::data if there are too few.
  virtual void load(const StoredRun& source) = 0;
  /// What was loaded, one line each; and what is odd about it.
  virtual std::vector<std::string> describe() const = 0;
  virtual std::vector<std::string> warnings() const = 0;
  /// Channels and side of a code.
  virtual std::array<int64_t, 2> code_shape() const = 0;
  /// What it knows of the codes; holds as long as this lives. Needs no assets to be loaded.
  virtual CodeDenoiser denoiser() const = 0;
  virtual PriorScore score() = 0;
  /// The same wish gives the same assets. Fault::usage for a class or time of day that was not in training.
  virtual std::vector<NewAsset> generate(const AssetWish& wish) = 0;
};

/// As many assets of each class and time of day as there are in `like`, for sets that are to be compared: of a few
/// hundred that are drawn freely, the share of buses or of nights moves their distance by more than their looks do.
std::vector<NewAsset> assets_like(AssetPrior& prior, CodeSource source, const std::vector<NewAsset>& like);

}  // namespace cloam
