// Latent diffusion of assets (GenAssets, stage 2): a U-Net learns to tell noise from the codes of a run of genassets,
// by class and time of day; its samples are codes of new assets. docs/methods/genassets.md has the whole.
#pragma once
#include <memory>

#include "models/latents/code_network.h"
#include "models/methods/code_set.h"
#include "models/train/learns_from_run.h"
#include "models/train/method.h"
#include "models/train/mixed_precision.h"

namespace cloam {

struct DiffusionConfig {
  int channels = 32, side = 8;  // of the codes
  int base = 128, blocks = 2, groups = 32;
  std::string multipliers = "1,2,4";
  std::string betas = "linear";
  int timesteps = 1000;
  int batch = 128;
  bool wiener = false;    // the network adds to the Wiener denoiser of the training codes
  float drop = 0.1f;      // share of the codes whose conditions are dropped
  float held_out = 0.1f;  // share of the codes
  int min_steps = 1;      // of an actor in the run's training
  bool half = false;      // the U-Net keeps what its convolutions read in half precision
  bool drawn = true;      // codes as mean and noise of their own deviation; false: the mean alone
  float min_snr = 0;      // gamma; 0: all times weigh the same
  float rate = 1e-4f, final_rate = 1, average = 0.9999f;
};

class Diffusion final : public Method, public LearnsFromRun, public GeneratesAssets, public MixedPrecision {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return network_->parameters(); }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  int64_t most_shares() const override { return config_.batch; }
  void after_step(const Progress& progress) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

  std::map<std::string, std::string> settings_from(const SourceRun& source) const override;
  void load(const SourceRun& source) override;
  std::vector<std::string> describe() const override { return codes_->describe(); }
  std::vector<std::string> warnings() const override;
  std::array<int64_t, 2> code_shape() const override { return {config_.channels, config_.side}; }
  CodeDenoiser denoiser() const override;
  PriorScore score() override;
  std::vector<NewAsset> generate(const AssetRequest& wish) override;

 private:
  struct Loss {
    double of_network = 0, of_zero = 0, of_gaussians = 0, floor = 0;
  };
  /// Mean over the rows, several times each, with the averaged network; of Gaussians, if any are given.
  Loss v_loss(const std::vector<int32_t>& rows, const CodeGaussians* gaussians) const;
  /// Of the training codes; fitted when they are first asked for.
  const CodeGaussians& gaussians();
  /// Standardised codes of assets as the wish says where they come from.
  Tensor codes_for(const AssetRequest& wish, const std::vector<NewAsset>& assets);
  /// Standardised codes of assets of these classes and times of day.
  Tensor sampled(const AssetRequest& wish, const std::vector<NewAsset>& assets) const;

  DiffusionConfig config_;
  uint64_t seed_ = 0;
  std::unique_ptr<CodeNetwork> network_;
  std::unique_ptr<CodeSet> codes_;
  std::unique_ptr<CodeGaussians> gaussians_;
};

}  // namespace cloam
