// GenAssets learning: its losses, parameter groups and steps, on patches or on whole images in tiles.
#pragma once
#include <deque>

#include "models/methods/genassets_model.h"
#include "models/nn/feature_network.h"
#include "models/nn/patch_discriminator.h"
#include "models/street/tiles.h"

namespace cloam {

struct GenAssetsConfig {
  StreetModelOptions street;
  bool whole_images = false;
  int tile_rays = 16384, tile_side = 96;
  int patches = 4, patch_side = 32, lidar_rays = 1024;
  int objects = 1, object_side = 256;  // patches of actors' boxes a step, and the pixels that they are resized to
  float weight_rgb = 1, weight_perceptual = 0.1f, weight_adversarial = 0.001f, weight_lidar = 0.01f,
        weight_line_of_sight = 0.01f, weight_silhouette = 0, weight_kl = 1e-5f;
  std::string discriminator_widths = "64,128,256,512";
  std::string perceptual_weights;  // file; empty: fixed random features
  float rate_codes = 0.05f, rate_decoder = 1e-4f, rate_field = 1e-3f, rate_image = 1e-3f, rate_background = 0.02f,
        rate_discriminator = 1e-4f;
  bool linear_lidar = true;  // LiDAR depth errors count linearly beyond a metre
  float final_rate = 0.1f, decay_start = 0.3f;
  CodePriorOptions prior;
};

/// A step, and the codes of the actors that it met.
struct StreetStep {
  Step step;
  VisibleCodes codes;
};

class GenAssetsTraining {
 public:
  /// Both must outlive this.
  GenAssetsTraining(const GenAssetsConfig& config, StreetModel& model, const Scope& networks, uint64_t seed);
  /// denoised: the codes were, so that they fit already.
  ParameterGroups groups(bool denoised) const;
  StreetStep step(const Progress& progress, const Tensors& wanted);
  /// Once the logs have their data: voxels of logs that no step to come sees leave the device, those of the next steps
  /// are unpacked ahead, where the data have a store.
  void unpack_ahead();
  void after_step();
  /// Of the samples marched to, those that light reaches, in thousandths: part of a run's state.
  int64_t lit_permille = 1000;

 private:
  struct WholeImage;
  /// Announces what the steps after this one will read, so that it is decoded meanwhile.
  void look_ahead(const Progress& progress);
  /// The log of the step, whose voxels are on the device.
  const StreetLog& met(size_t log);
  Sampling sampling(const StreetLog& log, const Progress& progress, bool skip_hidden) const;
  StreetStep on_patches(const StreetLog& log, HostRandom& random, const Progress& progress, const Tensors& wanted);
  StreetStep in_tiles(const StreetLog& log, HostRandom& random, const Progress& progress, const Tensors& wanted);
  struct Compared {
    Tensor image, truth;
    Tensor squared;       // mean squared error
    float share = 1;      // of a whole image, that the window is
    bool window = false;  // terms that it is too small for are left out
  };
  Tensor image_loss(const Compared& of) const;
  /// The perceptual loss of an actor's box: [1,3,h,w] both.
  Tensor object_loss(const Tensor& image, const Tensor& truth) const;
  bool sees_objects() const { return perceptual_ && config_.objects > 0; }
  Tensor adversarial_loss(const Tensor& image, const Tensor& truth) const;
  /// total, and the silhouette loss of actors' opacity [R] along rays; wanted: Photographed::silhouette, may be empty.
  Tensor with_silhouette(const Tensor& total, const Tensor& opacity, const Tensor& wanted) const;
  Tensor lidar_terms(const Tensor& depth, const Tensor& ranges, const Tensor& line_of_sight) const;

  double samples_ = 0, marched_ = 0;  // of the last step, shaded and marched to
  bool skipped_ = false;              // it left out the dark ones
  const GenAssetsConfig& config_;
  StreetModel& model_;
  uint64_t seed_;
  int64_t announced_ = 0;                     // the last step that was
  std::optional<Stored<StreetCells>> cells_;  // of the logs; none: all that are met stay on the device
  std::deque<size_t> shown_;                  // logs whose voxels are on the device, the last one met at the end
  std::optional<FeatureNetwork> perceptual_;
  std::optional<PatchDiscriminator> discriminator_;
};

/// Whole images: cells around a window that its pixels depend on, as far as it matters.
constexpr int64_t kHalo = 8;

}  // namespace cloam
