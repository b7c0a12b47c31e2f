// The latent codes that a run of genassets learned, as the data of methods that learn from them: standardised, some
// held out; and the actors that they are of.
#pragma once
#include "models/latents/generates_assets.h"
#include "models/train/learns_from_run.h"
#include "runtime/ops.h"

namespace cloam {

/// Of codes at the start: parameters hold what is added to it.
constexpr float kCodeLogVariance = -6;

/// Of A actors of all logs. means, deviations: [A, channels, side, side]; deviations empty where codes are plain.
struct AssetCodes {
  int64_t channels = 0, side = 0;
  std::vector<float> means, deviations;
  std::vector<int32_t> classes, nights;  // asset_class.h; 1: its log is of the night
  std::vector<Eigen::Vector3d> sizes;    // of their boxes, metres
  int64_t unseen = 0;                    // actors that are left out: fewer than `least_steps` steps trained them
  std::size_t count() const { return classes.size(); }
};

/// Side and channels of the codes, as settings of genassets say. Fault::data for a run of another method, an edited
/// one, and one whose actors have no codes.
struct CodeShape {
  int64_t channels, side;
  bool variational;
};
CodeShape code_shape(const SourceRun& source);

/// Fault::data for what does not fit together, and for runs of no actor that was seen.
AssetCodes asset_codes(const SourceRun& source, int64_t min_steps);

/// Codes [N,C,H,W] as rows [N,C*H*W].
Eigen::MatrixXd as_rows(const Tensor& codes);

class CodeSet {
 public:
  /// Of no codes yet: mean 0 and deviation 1 until take() or restore().
  explicit CodeSet(int64_t channels);
  /// Two codes or more. `held_out`: share of them; the seed says which.
  void take(AssetCodes codes, float held_out, uint64_t seed);

  const AssetCodes& codes() const { return codes_; }
  const std::vector<int32_t>& training() const { return training_; }
  const std::vector<int32_t>& held_out() const { return held_out_; }
  const std::vector<float>& mean() const { return mean_; }
  const std::vector<float>& deviation() const { return deviation_; }
  /// Standardised codes c = mu + sigma e [N,C,side,side] of some rows.
  Tensor draw(const std::vector<int32_t>& rows, const RandomKey& key) const;
  /// Some rows, standardised.
  CodeTable table(const std::vector<int32_t>& rows, const RandomKey& key) const;
  /// dropped: of each row; empty: none.
  Condition condition_of(const std::vector<int32_t>& rows, const std::vector<bool>& dropped = {}) const;
  /// The least v-loss at a level: v = (alpha x_t - x) / sigma, and of a code N(mean, s^2) a variance of s^2 sigma^2 /
  /// (alpha^2 s^2 + sigma^2) is left when mean and x_t are known.
  Tensor floor_of(const std::vector<int32_t>& rows, const Level& level) const;

  /// A training actor of the class and time of day that the wish names: those two, but the class where no actor is
  /// both. Fault::usage for a class that none is of.
  int32_t drawn_actor(const AssetRequest& wish, uint64_t index) const;
  /// The box of the training actor of a class whose code is nearest to another, by standardised numbers.
  Eigen::Vector3d nearest_size(const std::vector<float>& code, int asset_class) const;
  /// The actors of training that the wish fits, from its first on, as they are. Fault::usage if none fits.
  std::vector<NewAsset> training_assets(const AssetRequest& wish) const;
  /// Training codes of a class and time of day; of the class, or of all, where there are none.
  std::vector<std::vector<float>> examples(int32_t asset_class, int32_t night) const;
  /// One line each.
  std::vector<std::string> describe() const;
  /// Tensors "mean" and "deviation".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  void standardise();
  NewAsset actor_at(int32_t row) const;

  AssetCodes codes_;
  std::vector<int32_t> training_, held_out_;  // places in codes_
  std::vector<float> mean_, deviation_;       // [C]: of the training codes
  Tensor means_, deviations_;                 // standardised [A,C,H,W]; deviations_ empty where codes are plain
};

}  // namespace cloam
