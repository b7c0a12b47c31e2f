// Capability: makes assets that no log shows.
#pragma once
#include "models/diffusion/code_gaussians.h"
#include "models/latents/code_denoiser.h"
#include "models/latents/new_assets.h"
#include "models/scene/asset_class.h"

namespace cloam {

/// How well noise is told from assets that were held out. v-loss: mean squared error of v (schedule.h).
struct PriorScore {
  int64_t codes = 0, training_codes = 0;
  double v_loss = 0, zero_v_loss = 0;  // on the codes held out; of predicting zero
  double floor_v_loss = 0;             // of knowing each of their means: the codes' own noise cannot be predicted
  double wiener_v_loss = 0;            // of the best denoiser of Gaussians of the training codes (code_gaussians.h)
  double training_v_loss = 0;
  Shrinkage shrinkage = {};  // of those Gaussians
};

/// Where codes come from: samples of the network; what it must beat, which is samples of a Gaussian of each class and
/// time of day with its full covariance, the mean of that, and white noise of each channel's mean and deviation, which
/// knows of no class; or the codes that it was trained on, as they are.
enum class CodeSource { sampled, gaussian, mean, random, training };
constexpr int kAllCodes = 1000000;  // a count beyond that of any training

struct AssetRequest {
  int count = 1;                        // of training codes: at most
  std::optional<int> asset_class = {};  // of kAssetClasses; none: as often as in training
  std::optional<bool> night = {};       // none: as often as in training, of that class
  uint64_t seed = 0;
  float guidance = 1;
  int steps = 50;
  CodeSource codes = CodeSource::sampled;
  int first = 0;  // of the `count` that are made, in a longer wish: a multiple of 64
};

class GeneratesAssets {
 public:
  virtual ~GeneratesAssets() = default;
  /// Channels and side of a code.
  virtual std::array<int64_t, 2> code_shape() const = 0;
  /// What it knows of the codes; holds as long as this lives. Needs no assets to be loaded.
  virtual CodeDenoiser denoiser() const = 0;
  virtual PriorScore score() = 0;
  /// The same wish gives the same assets, and its parts (`first`) give them again. Fault::usage for a class or time of
  /// day that was not in training.
  virtual std::vector<NewAsset> generate(const AssetRequest& wish) = 0;
};

/// As many assets of each class and time of day as there are in `like`, for sets that are to be compared: of a few
/// hundred that are drawn freely, the share of buses or of nights moves their distance by more than their appearance
/// does.
std::vector<NewAsset> assets_like(GeneratesAssets& prior, CodeSource source, const std::vector<NewAsset>& like);

}  // namespace cloam
