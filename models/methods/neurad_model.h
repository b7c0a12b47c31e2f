// NeuRAD's street: a field over hash grids, rendered along rays to features, which an image decoder makes pictures of.
#pragma once
#include <memory>
#include <string>

#include "models/batches/log_source.h"
#include "models/fields/neurad_field.h"
#include "models/methods/camera_refinement.h"
#include "models/nn/image_decoder.h"
#include "models/street/has_surfaces.h"
#include "models/street/street_boxes.h"
#include "models/street/street_views.h"

namespace cloam {

struct NeuradOptions {
  NeuradFieldOptions field;
  StreetSpaceOptions space;
  StreetSteps steps;
  ImageDecoderOptions image{.width = 32, .side = 7, .blocks = 4, .doublings = 1};
  int lidar_width = 32;       // of the network that tells a return's intensity and whether there is one
  int appearance = 16;        // numbers of a sensor's embedding; 0: none
  float appearance_rate = 1;  // embeddings a second, between which they are linear
  float flip = 0.25f;         // how often an actor is seen mirrored in training
  float near = 0.1f;          // metres around a LiDAR's return where matter belongs
};

/// How samples are placed; without a key: in the middle, and nothing is mirrored.
struct NeuradSampling {
  RandomKey key = {};
  bool random = false;
  uint32_t share = 0;        // of the batch: each shifts the samples along its rays by numbers of its own
  RaysInStreet rays = {};    // in the place of the list's, and differentiable; empty: the list's
  bool moves_boxes = false;  // the scene's boxes are differentiable
};

/// What rays meet.
struct NeuradScene {
  StreetBoxes boxes;
  StreetGrid grid;
  std::vector<int32_t> looks;  // of the boxes' owners: whose rows of the table they wear
  std::vector<float> shrink;   // of the same: from metres to the cube that their looks fill
};

struct NeuradRays {
  StreetSamples samples;
  int64_t marched = 0;                           // samples before the hidden ones were left out
  Tensor alpha, features, depth;                 // [S] by row; [R,F]; [R]
  Tensor opacity, actor_opacity, line_of_sight;  // [R]
};

class NeuradModel {
 public:
  /// Fault::usage for settings that do not fit together.
  NeuradModel(const NeuradOptions& options, const Scope& root, const Scene& scene);

  StreetSpace& space() { return *space_; }
  const StreetSpace& space() const { return *space_; }
  const NeuradOptions& options() const { return options_; }
  int scale() const { return image_->scale(); }
  std::shared_ptr<const Scene> scene() const { return scene_.get(); }
  /// Actors are where this scene has them; as many as before.
  void take(RestingScene scene) { scene_ = std::move(scene); }

  NeuradScene street(const RayList& rays) const;
  /// One actor's looks in its box's axes and nothing around it but the sky.
  NeuradScene alone(std::size_t actor) const;
  /// Solid angles of the rays: [R].
  NeuradRays render(const NeuradScene& scene, const RayList& rays, const Tensor& angles,
                    const NeuradSampling& how) const;
  /// Shares of the embeddings for sensors at times: [N, embeddings]. Of a name that is no sensor's, of all cameras
  /// alike.
  Tensor embedding_shares(const std::vector<std::pair<std::string, double>>& sensors) const;
  /// features [N,F,H,W], shares [N,embeddings] -> RGB at the image's size.
  Tensor image_of(const Tensor& features, const Tensor& shares) const;
  /// What comes back along a LiDAR's rays.
  struct Returns {
    Tensor intensity;  // [R] in [0,1]
    Tensor missing;    // [R] logits: that nothing does
  };
  /// features [R,F], shares [R,embeddings].
  Returns returns_of(const Tensor& features, const Tensor& shares) const;
  /// sensor, time: whose embedding the picture has; angle: of a ray, solid.
  struct Seer {
    std::string sensor;
    double time = 0;
    float angle = 0;
  };
  StreetPainter painter(const std::function<NeuradScene(const RayList&)>& scene, const Seer& seer) const;
  AssetSamples sample_asset(std::size_t actor, const std::vector<float>& points) const;
  /// Fault::data for a name that is no actor's of the run.
  std::size_t place_of(const AssetName& asset) const;

 private:
  StreetGrid grid() const;
  FieldPoints background_points(const StreetSamples& s, const Tensor& metres) const;
  Tensor widths_of(const StreetSamples& s, const Tensor& angles) const;
  FieldPoints actor_points(const NeuradScene& scene, const StreetSamples& s, const Tensor& metres) const;
  Tensor encoded(const NeuradScene& scene, const StreetSamples& s, const Tensor& angles) const;
  void mirror(StreetSamples& samples, const NeuradScene& scene, const NeuradSampling& how) const;

  NeuradOptions options_;
  RestingScene scene_;
  std::unique_ptr<StreetSpace> space_;
  std::unique_ptr<NeuradField> field_;
  std::unique_ptr<ImageDecoder> image_;
  std::unique_ptr<SmallMlp> lidar_;
  std::vector<std::string> sensors_;
  double first_ = 0;     // second of the first photo
  int64_t moments_ = 1;  // embeddings a sensor
  Tensor embeddings_;    // [sensors * moments, appearance]
};

/// What the LiDARs are called among the sensors.
constexpr char kLidarName[] = "lidar";
/// Of a ray that stands for `scale` pixels a side: solid angle.
float pixel_angle(double focal, int scale);
constexpr float kBeamAngle = 3e-3f * 1.5e-3f;  // of a LiDAR's beam: its divergence, NeuRAD's implementation

}  // namespace cloam
