// Latent diffusion of assets (GenAssets, stage 2): a U-Net learns to tell noise from the codes of a run of genassets,
// by class and time of day; its samples are codes of new assets. docs/methods/genassets.md has the whole.
#pragma once
#include <memory>

#include "models/diffusion/noise_schedule.h"
#include "models/diffusion/unet.h"
#include "models/latents/generates_assets.h"
#include "models/methods/asset_codes.h"
#include "models/train/learns_from_run.h"
#include "models/train/method.h"

namespace cloam {

struct DiffusionConfig {
  int channels = 32, side = 8;  // of the codes
  int base = 128, blocks = 2, groups = 32;
  std::string multipliers = "1,2,4";
  std::string betas = "linear";
  int times = 1000;
  int batch = 128;
  float drop = 0.1f;      // share of the codes whose conditions are dropped
  float held_out = 0.1f;  // share of the codes
  int least_steps = 1;    // of an actor in the run's training
  bool drawn = true;      // codes as mean and noise of their own deviation; false: the mean alone
  float min_snr = 0;      // gamma; 0: all times weigh the same
  float rate = 1e-4f, final_rate = 1, average = 0.9999f;
};

class Diffusion final : public Method, public LearnsFromRun, public GeneratesAssets {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override;
  Step step(const Progress& progress, const Tensors& wanted) override;
  void after_step(const Progress& progress) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

  std::map<std::string, std::string> settings_from(const SourceRun& source) const override;
  void load(const SourceRun& source) override;
  std::vector<std::string> describe() const override;
  std::vector<std::string> warnings() const override;
  std::array<int64_t, 2> code_shape() const override { return {config_.channels, config_.side}; }
  CodeDenoiser denoiser() const override;
  PriorScore score() override;
  std::vector<NewAsset> generate(const AssetWish& wish) override;

 private:
  struct Loss {
    double of_network = 0, of_zero = 0, floor = 0;
  };
  void split();
  void standardise();
  Shape shape_of(int64_t count) const { return {count, config_.channels, config_.side, config_.side}; }
  /// Standardised codes c = mu + sigma e.
  Tensor draw(const std::vector<int32_t>& rows, const RandomKey& key) const;
  Condition condition_of(const std::vector<int32_t>& rows, const std::vector<bool>& dropped) const;
  /// The v that a network predicts.
  Tensor predict(const Unet& unet, const Tensor& noisy, const Tensor& t, const Condition& condition) const;
  /// The least v-loss at a level: v = (alpha x_t - x) / sigma, and of a code N(mean, s^2) a variance of s^2 sigma^2 /
  /// (alpha^2 s^2 + sigma^2) is left when mean and x_t are known.
  Tensor floor_of(const std::vector<int32_t>& rows, const Level& level) const;
  /// Mean over the rows, several times each, with the averaged network.
  Loss v_loss(const std::vector<int32_t>& rows) const;
  int32_t drawn_actor(const AssetWish& wish, uint64_t index) const;
  /// The box of the training actor of a class whose code is nearest to another, by standardised numbers.
  Eigen::Vector3d nearest_size(const std::vector<float>& code, int asset_class) const;
  /// The first actors of training that the wish fits, as they are.
  std::vector<NewAsset> training_assets(const AssetWish& wish) const;
  /// Standardised codes of assets of these classes and times of day.
  Tensor sampled(const AssetWish& wish, const std::vector<NewAsset>& assets) const;

  DiffusionConfig config_;
  uint64_t seed_ = 0;
  Params params_, ema_;                    // of one set of names
  std::unique_ptr<Unet> unet_, ema_unet_;  // of params_ and of ema_
  std::optional<NoiseSchedule> schedule_;
  AssetCodes codes_;
  std::vector<int32_t> training_, held_out_;  // places in codes_
  std::vector<float> mean_, deviation_;       // [C]: of the training codes
  Tensor means_, deviations_;                 // standardised [A,C,H,W]; deviations_ empty where codes are plain
};

}  // namespace cloam
