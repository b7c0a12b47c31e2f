// GenAssets, stage 1 ("Generating in-the-wild 3D Assets in Latent Space", CVPR 2025): driving logs to streets whose
// actors are assets of their own. A small latent code an actor, decoded to tri-planes by one network for all, is placed
// in its boxes and rendered together with the background's tri-planes. docs/methods/genassets.md has the whole.
#pragma once
#include "models/latents/shows_assets.h"
#include "models/latents/takes_prior.h"
#include "models/methods/genassets_training.h"
#include "models/street/has_surfaces.h"
#include "models/street/refines_boxes.h"
#include "models/street/street.h"
#include "models/street/takes_edits.h"
#include "models/train/learns_from_captures.h"
#include "models/train/mixed_precision.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"
#include "models/train/shares_networks.h"
#include "models/train/takes_shapes.h"

namespace cloam {

/// A photo [height,width,3].
struct ShownImage {
  std::vector<float> rgb;
  int64_t height, width;
};

class GenAssets final : public Method,
                        public LearnsFromCaptures,
                        public RendersViews,
                        public Street,
                        public HasSurfaces,
                        public HasSurroundings,
                        public TakesEdits,
                        public RefinesBoxes,
                        public RefinesCameras,
                        public TakesShapes,
                        public SharesNetworks,
                        public TakesPrior,
                        public ShowsAssets,
                        public MixedPrecision {
 public:
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  bool images_on_device() const override { return false; }
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override { return training_->groups(prior_ && prior_->finds()); }
  Step step(const Progress& progress, const Tensors& wanted) override;
  int64_t most_shares() const override { return config_.whole_images ? kMostShares : config_.patches; }
  void after_step(const Progress& progress) override;
  void fit_to(const TensorMap& parameters) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

  Picture render(const View& view) override;
  LidarReturns measure(const WorldRays& rays) override;
  Picture render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) override;
  AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) override;
  Mesh surroundings(int log, int resolution) override;
  void take_actors(const Scenes& scenes) override;
  std::vector<Actor> refined_actors(int log) const override;
  std::vector<Eigen::Matrix4d> refined_poses(int log) const override;
  std::vector<LensChange> lens_changes(int log) const override;
  void adopt_networks(const TensorMap& parameters) override;
  void adopt_prior(const CodeDenoiser& denoiser) override;
  std::vector<AssetName> show_assets(const std::vector<NewAsset>& assets) override;

 private:
  void find_codes();
  /// How badly the one image that trains is rendered where actors are: the mean squared error in each one's 2-D box.
  std::vector<double> errors_at(const std::vector<int32_t>& actors, const ShownImage& photo);

  GenAssetsConfig config_;
  uint64_t seed_ = 0;
  Params params_;
  std::unique_ptr<StreetModel> model_;
  std::unique_ptr<GenAssetsTraining> training_;
  std::unique_ptr<CodePrior> prior_;
};

}  // namespace cloam
