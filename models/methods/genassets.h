// GenAssets, stage 1 ("Generating in-the-wild 3D Assets in Latent Space", CVPR 2025): driving logs to streets whose
// actors are assets of their own. A small latent code an actor, decoded to tri-planes by one network for all, is placed
// in its boxes and rendered together with the background's tri-planes. docs/methods/genassets.md has the whole.
#pragma once
#include <memory>

#include "models/fields/asset_decoder.h"
#include "models/fields/street_field.h"
#include "models/methods/code_prior.h"
#include "models/nn/feature_network.h"
#include "models/nn/image_decoder.h"
#include "models/nn/patch_discriminator.h"
#include "models/render/street_data.h"
#include "models/train/method.h"
#include "runtime/ops/street.h"

namespace cloam {

/// Of codes at the start: parameters hold what is added to it.
constexpr float kCodeLogVariance = -6;
/// Whole images: cells around a window that its pixels depend on, as far as it matters.
constexpr int64_t kHalo = 8;

struct GenAssetsConfig {
  StreetFieldOptions field;
  StreetSpaceOptions space;
  StreetSteps steps;
  ImageDecoderOptions image;
  int code_side = 8, code_channels = 32;             // latent code of an actor
  std::string decoder_widths = "256,128,128,64,64";  // of the blocks; the planes double before each but the first
  int decoder_middle = 256, decoder_groups = 32;
  bool decoder = true;      // false: actors' tri-planes are learned directly (Table A2)
  bool variational = true;  // codes as (mean, log variance) with the KL term
  bool symmetric = false;   // left and right, in their boxes' x
  float view_drop = 0.5f;   // share of the steps that see actors without a view direction
  bool shadows = true;
  int background_side = 256;  // texels
  bool whole_images = false;
  int tile_rays = 16384, tile_side = 96;
  int patches = 4, patch_side = 32, lidar_rays = 1024;
  float weight_rgb = 1, weight_perceptual = 0.1f, weight_adversarial = 0.001f, weight_lidar = 0.01f,
        weight_stray = 0.01f, weight_kl = 1e-5f;
  std::string discriminator_widths = "64,128,256,512";
  std::string perceptual_weights;  // file; empty: fixed random features
  float near = 0.1f;               // metres around a LiDAR's return where matter belongs
  float rate_codes = 0.05f, rate_decoder = 1e-4f, rate_field = 1e-3f, rate_image = 1e-3f, rate_background = 0.02f,
        rate_discriminator = 1e-4f, decay_background = 0.2f;
  float final_rate = 0.1f, decay_start = 0.3f;
  CodePriorOptions prior;
};

class GenAssets final : public Method, public Street {
 public:
  const char* name() const override { return "genassets"; }
  void configure(Config& config) override;
  void build(const Scenes& scenes, uint64_t seed) override;
  void load_data(std::vector<TrainingData> data) override;
  MemoryPlan memory(const PhotoSizes& photos) const override;
  Params& parameters() override { return params_; }
  std::vector<LearningRate> learning_rates(const Progress& progress) const override;
  Tensor loss(const Progress& progress) override;
  Gradients gradients(const Progress& progress, const Tensors& wanted) override;
  Tensors observed() const override;
  void after_step(const Progress& progress) override;
  std::map<std::string, double> metrics() const override;
  Picture render(const View& view) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;
  void adopt_networks(const TensorMap& parameters) override;
  void adopt_prior(const CodeDenoiser& denoiser) override;
  Street* street() override { return this; }
  LidarReturns measure(const WorldRays& rays) override;
  Picture render_asset(const AssetName& asset, const Camera& camera, const Eigen::Matrix4d& box_from_camera) override;
  AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) override;
  AssetName add_asset(const NewAsset& asset) override;

 private:
  struct AssetPlace {
    size_t log, actor;
    bool operator==(const AssetPlace&) const = default;
  };
  struct Log {
    Scene scene;
    std::shared_ptr<StreetSpace> space;  // of generated assets: that of another log
    std::unique_ptr<StreetData> data;
    Tensor background;  // [3 side^2, channels]
    Tensor assets;      // codes [A, ...] or planes [A, ...]
    // What a log's texels at one height, and all its codes, have in common is added to them: where no camera looked,
    // there is nothing else.
    Tensor common_background, common_code;  // [2 heights, 3 channels], [1, ...]; of planes there is none
    std::vector<int32_t> classes;           // of the actors
    std::vector<AssetPlace> looks;          // of the actors: whose asset they wear
  };
  /// What rays meet.
  struct Stage {
    const Log& log;
    StreetBoxes boxes;
    StreetGrid grid;
    std::vector<AssetPlace> looks;  // of the boxes' owners
  };
  /// Streams of random numbers within a step.
  enum Stream : uint32_t { kJitter = 0, kCodes = 1 };
  /// How samples are placed and codes drawn; without a key: in the middle, and the mean.
  struct Drawing {
    RandomKey key;
    bool random = false;
    bool skim = true;    // leave out samples behind surfaces
    bool blind = false;  // actors are seen without a view direction
    bool apart = false;  // where rays meet boxes, the background learns nothing
    RandomKey of(Stream stream) const { return {key.seed, key.step, stream}; }
  };
  struct Met {
    std::vector<int32_t> slot_of;    // of the log's actors; -1: none
    std::vector<AssetPlace> assets;  // by slot
  };
  struct Decoded {
    Tensor planes;  // [3,N,side,side,channels]; empty: no asset is met
    Tensor kl;      // mean over the codes' numbers; empty without
    Tensor slots;   // int32: place in planes of each of the stage's actors
    MetCodes codes = {};
  };
  struct Shaded {
    StreetSamples samples;
    int64_t marched = 0;                   // samples before the dark ones were left out
    Tensor alpha;                          // [S] by row
    Tensor features, depth;                // [R,features], [R]
    Tensor opacity, actor_opacity, stray;  // [R]
    Tensor shadow;                         // [R,3] factors; empty: none
    Tensor kl;
    MetCodes codes;
    int64_t actors = 0;  // decoded
  };
  Log make_log(const Scene& scene, const Scope& scope) const;
  void find_looks();
  AssetPlace place_of(const AssetName& asset) const;
  /// From metres in a box of that size to its cube of side 1.
  static float cube_scale(const Eigen::Vector3d& size);
  Eigen::Vector3d size_of(const AssetPlace& place) const;
  Stage street(const Log& log, const RayList& rays) const;
  Stage alone(const Log& log, const AssetPlace& place) const;
  StreetBoxes boxes_of(const Log& log, const RayList& rays) const;
  int64_t planes_side() const;  // texels of actors
  UnetCondition condition_of(const std::vector<AssetPlace>& assets) const;
  Decoded decode(const std::vector<AssetPlace>& assets, const Drawing& how) const;
  Tensor asset_rows(const std::vector<AssetPlace>& assets) const;
  Met meet(const Stage& stage, const StreetSamples& samples) const;
  Tensor in_cube(const Tensor& points) const;
  bool blind(const Progress& progress) const;
  static Tensor actor_views(const Tensor& directions, bool blind);
  static Tensor heights(const Tensor& points);
  static Tensor apart(const Tensor& texels, const StreetSamples& samples);
  Drawing drawing(const Log& log, const Progress& progress, bool skim) const;
  Tensor features_at(const Log& log, const StreetSamples& samples, const Tensor& planes, const Tensor& slots) const;
  Shaded shade(const Stage& stage, const RayList& rays, const Drawing& how, bool shadows,
               const Decoded* ready = nullptr) const;
  Decoded decode_met(const Met& met, const Drawing& how) const;
  Tensor shadows_of(const Log& log, const Shaded& shaded, const Tensor& planes, const Tensor& slots) const;
  Tensor image_of(const Tensor& features, const Tensor& shadow) const;
  Tensor adversarial_loss(const Tensor& image, const Tensor& truth) const;
  Tensor window_loss(const Tensor& image, const Tensor& truth, float share) const;
  struct WholeImage;
  WholeImage whole_image(const Progress& progress) const;
  Tensor lidar_loss(const Tensor& depth, const Tensor& ranges) const;
  Gradients gradients_in_tiles(const Progress& progress, const Tensors& wanted);
  void denoise_image();

  GenAssetsConfig config_;
  uint64_t seed_ = 0;
  Params params_;
  std::vector<Log> logs_;
  std::unique_ptr<StreetField> field_;
  std::unique_ptr<AssetDecoder> decoder_;
  std::unique_ptr<ImageDecoder> image_;
  std::optional<SmallMlp> shadow_;
  std::optional<FeatureNetwork> perceptual_;
  std::optional<PatchDiscriminator> discriminator_;
  std::unique_ptr<CodePrior> prior_;
  MetCodes met_codes_;           // of the last loss, until its gradients are taken
  bool frozen_ = false;          // the networks are another run's
  int64_t lit_permille_ = 1000;  // of the samples marched to, those that light reaches
  int64_t last_samples_ = 0, last_actors_ = 0;
  Tensors observed_;  // means of the last step: squared colour error, LiDAR error
};

}  // namespace cloam
