// GenAssets' street: a field over the background's planes and those that a decoder makes of actors' codes, rendered
// along rays. One set of networks for all logs.
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <optional>

#include "models/batches/log_source.h"
#include "models/fields/asset_decoder.h"
#include "models/fields/street_field.h"
#include "models/latents/code_prior.h"
#include "models/latents/new_assets.h"
#include "models/methods/box_refinement.h"
#include "models/methods/camera_refinement.h"
#include "models/nn/image_decoder.h"
#include "models/street/static_surface.h"
#include "models/street/street_boxes.h"
#include "models/street/street_views.h"

namespace cloam {

struct StreetModelOptions {
  StreetFieldOptions field;
  int plane_channels = 12;
  StreetSpaceOptions space;
  StreetSteps steps;
  ImageDecoderOptions image;
  int code_side = 8, code_channels = 32;             // latent code of an actor
  std::string decoder_widths = "256,128,128,64,64";  // of the blocks; the planes double before each but the first
  int decoder_middle = 256, decoder_groups = 32;
  bool decoder = true;      // false: actors' tri-planes are learned directly (Table A2)
  bool variational = true;  // codes as (mean, log variance) with the KL term
  bool symmetric = false;   // left and right, in their boxes' x
  bool shadows = true;
  bool class_places = true, code_bypass = true;  // asset_decoder.h
  bool common_background = true;                 // see StreetLog
  bool frozen = false;                           // the networks are another run's and stand still
  bool detail = true;                            // then: see StreetLog
  int background_side = 256;                     // texels
  float near = 0.1f;                             // metres around a LiDAR's return where matter belongs
  BoxSettings boxes;
  CameraSettings cameras;  // poses at the rate of captures: at that of kPosesOfLogs they drift away
};

/// An actor of a log; or, with the number of logs, a generated asset.
struct AssetPlace {
  size_t log, actor;
  bool operator==(const AssetPlace&) const = default;
};

struct StreetLog {
  RestingScene scene;
  bool night = false;
  std::unique_ptr<StreetSpace> space;
  std::unique_ptr<LogSource> data;
  Tensor background;  // [3 side^2, channels]
  Tensor assets;      // codes [A, ...] or planes [A, ...]
  // [A, 3 side^2 channels]: texels that are added to what frozen networks decode. They hold what a code cannot say of
  // the sides that were seen.
  Tensor detail;
  // [2 heights, 3 channels]: what a log's texels at one height have in common is added to them; where no camera looked,
  // there is nothing else.
  Tensor common_background;
  std::vector<int32_t> classes;        // of the actors
  std::vector<AssetPlace> appearance;  // of the actors: whose asset they wear
  BoxRefinement boxes;                 // where the actors are
  LogCameras cameras;                  // how photos were taken
};

/// How samples are placed and codes drawn; without a key: in the middle, and the mean.
struct Sampling {
  RandomKey key = {};
  bool random = false;
  bool skip_hidden = true;         // leave out samples behind surfaces
  uint32_t share = 0;              // of the batch: each shifts the samples along its rays by numbers of its own
  bool detach_background = false;  // where rays meet boxes, the background learns nothing
  bool moves_boxes = false;        // the scene's boxes are differentiable
  RaysInStreet rays = {};          // in the place of the list's, and differentiable; empty: the list's
};

/// What rays meet.
struct RayScene {
  const StreetLog& log;
  StreetBoxes boxes;
  StreetGrid grid;
  std::vector<AssetPlace> appearance;  // of the boxes' owners
};

/// Actors that rays meet get slots: only they are decoded.
struct HitAssets {
  std::vector<int32_t> slot_of;    // of the owners; -1: none
  std::vector<AssetPlace> assets;  // by slot
};
HitAssets hit_assets(const std::vector<AssetPlace>& appearance, const std::vector<bool>& hit);

struct DecodedAssets {
  Tensor planes;  // [3,N,side,side,channels]; empty: no asset is met
  Tensor kl;      // from a standard normal: summed over a code's numbers, mean over codes; empty without
  Tensor slots;   // int32: place in planes of each owner
  VisibleCodes codes = {};
};

struct RenderedRays {
  StreetSamples samples;
  int64_t marched = 0;                           // samples before the hidden ones were left out
  Tensor alpha;                                  // [S] by row
  Tensor features, depth;                        // [R,features], [R]
  Tensor opacity, actor_opacity, line_of_sight;  // [R]
  Tensor shadow;                                 // [R,3] factors; empty: none
  DecodedAssets assets;
};

/// What actors look like: their codes, or planes, those of generated assets, and the network that decodes them.
class StreetAssets {
 public:
  /// The options and the logs must outlive this; logs come later, before anything is asked.
  StreetAssets(const StreetModelOptions& options, const Scope& networks, std::vector<StreetLog>& logs);
  /// Each actor's, once the logs are complete. An actor that wears an asset which is still to be generated has its own
  /// appearance until then.
  void find_appearance();
  /// In place of those before.
  void set_generated(const std::vector<NewAsset>& assets);
  /// Fault::data for a name that is no actor's of the run and no generated asset's.
  AssetPlace place_of(const AssetName& asset) const;
  Eigen::Vector3d size_of(const AssetPlace& place) const;
  bool at_night(const AssetPlace& place) const;
  /// Class and time of day.
  Condition condition_of(const std::vector<AssetPlace>& assets) const;
  DecodedAssets decode(const HitAssets& hits, const Sampling& how) const;
  /// Parameters stand still from here on: an asset that was decoded without chance is not decoded again.
  void keep_decoded() { keeps_ = true; }

 private:
  DecodedAssets decode_now(const HitAssets& hits, const Sampling& how) const;
  Tensor planes_of_one(const AssetPlace& asset, const Sampling& how) const;
  bool is_generated(const AssetPlace& place) const { return place.log == logs_.size(); }
  Tensor rows_of(const std::vector<AssetPlace>& assets,
                 const std::function<Tensor(size_t log, const Tensor& rows)>& rows_in) const;
  Tensor with_detail(const Tensor& planes, const std::vector<AssetPlace>& assets) const;

  const StreetModelOptions& options_;
  std::vector<StreetLog>& logs_;
  std::unique_ptr<AssetDecoder> decoder_;
  std::vector<NewAsset> generated_;
  Tensor generated_codes_;  // [G, ...] as rows of StreetLog::assets
  bool keeps_ = false;
  mutable std::map<std::pair<size_t, size_t>, Tensor> kept_;  // planes [3,1,...] by log and actor
};

class StreetModel {
 public:
  /// Fault::data for scenes that are no logs, Fault::usage for sizes that do not fit together.
  StreetModel(const StreetModelOptions& options, const Scope& root, const Scenes& scenes);

  RayScene street(const StreetLog& log, const RayList& rays) const;
  /// One asset in its box's axes and nothing around it but the sky of a log of its time of day.
  RayScene alone(const AssetPlace& place) const;
  RenderedRays render(const RayScene& scene, const RayList& rays, const Sampling& how, bool shadows,
                      const DecodedAssets* ready = nullptr) const;
  /// features [N,F,H,W] and shadow [N,3,H,W] (or empty) -> RGB at the image's size.
  Tensor image_of(const Tensor& features, const Tensor& shadow) const;
  StreetPainter painter(const std::function<RayScene(const RayList&)>& scene, bool shadows) const;
  AssetSamples sample_asset(const AssetPlace& place, const std::vector<float>& points) const;
  Mesh surroundings(const StreetLog& log, int resolution) const;

  StreetAssets& assets() { return *assets_; }
  const StreetModelOptions& options() const { return options_; }
  int scale() const { return image_->scale(); }
  std::vector<StreetLog>& logs() { return logs_; }

 private:
  StreetLog make_log(const Scene& scene, const Scope& scope) const;
  Tensor texels_of(const StreetLog& log, const StreetSamples& samples, const DecodedAssets& assets) const;
  Tensor shadow_of(const StreetLog& log, const RenderedRays& rendered) const;
  AssetSamples sample_surface(const std::vector<float>& points, bool coloured,
                              const std::function<Tensor(const Tensor& at)>& texels) const;

  StreetModelOptions options_;
  std::unique_ptr<StreetField> field_;
  std::unique_ptr<ImageDecoder> image_;
  std::optional<SmallMlp> shadow_;
  std::vector<StreetLog> logs_;
  std::unique_ptr<StreetAssets> assets_;
};

}  // namespace cloam
