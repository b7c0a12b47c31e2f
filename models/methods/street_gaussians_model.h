// The scene graph of Street Gaussians: the background's gaussians in the world, those of rigid actors in the axes of
// their boxes, and a sky, seen together.
#pragma once
#include <array>

#include "models/io/safetensors.h"
#include "models/methods/box_refinement.h"
#include "models/methods/camera_refinement.h"
#include "models/nn/params.h"
#include "models/scene/view.h"
#include "models/splat/initial_street.h"
#include "models/splat/placed.h"
#include "models/splat/settings.h"
#include "models/splat/sky_map.h"
#include "models/street/street.h"

namespace cloam {

struct StreetGaussiansConfig {
  StreetStartOptions start;
  float near = 0.2f;     // metres
  int sky_side = 1024;   // pixels of a face of the sky
  bool exposure = true;  // a gain and an offset a camera and channel
  BoxSettings boxes{.refine = true};
  CameraSettings cameras{.poses = kPosesOfLogs};
  float flip = 0;           // how often a step sees an actor mirrored
  int waves = 5;            // of an actor's base colour in time, the constant one included
  int actors_max = 300000;  // gaussians of all actors
  HarmonicSteps harmonics;
  float ssim = 0.2f;                                // weight; 1 - ssim is that of the absolute difference
  float sky = 0.05f, lidar = 0.01f, actors = 0.1f;  // weights
  float outside = 0.1f, hidden = 0.03f;             // weights
  int depth_every = 4;                              // steps
  GaussianRates rates;
  float rate_sky = 0.01f, rate_exposure = 1e-3f;
  GrowthOptions growth;
};

constexpr char kBackgroundPart[] = "background.", kActorsPart[] = "actors.", kWavesName[] = "actors.sh_time",
               kSkyName[] = "sky", kExposureName[] = "exposure";
constexpr float kFirstSky = 0.5f;  // grey

class StreetGaussiansModel {
 public:
  /// All must outlive this but the scene, which gives its actors. Parameters are put in by put().
  StreetGaussiansModel(const StreetGaussiansConfig& config, Params& parameters, const Scene& scene);

  void put(const StreetStart& start);
  /// Ground that no photo shows. It is shown, and has no part in training.
  void put_ground(const Gaussians& ground);
  /// As parameters have it (splat/parameters.h); empty: none.
  const Params& ground() const { return ground_; }
  /// Zeros in the place of all, of shapes as these have them.
  void fit_to(const TensorMap& parameters);
  /// The actors from here on: as many, in the same order.
  void take_actors(const std::vector<Actor>& actors) { actors_ = actors; }
  const std::vector<Actor>& actors() const { return actors_; }
  /// Of the actors' gaussians: place among actors().
  const std::vector<int32_t>& owners() const { return owners_; }
  void set_owners(std::vector<int32_t> owners);
  /// More gaussians, of the actor at that place; their base colour is the same at all times.
  void adopt(std::size_t actor, const Gaussians& looks);

  /// What is learned of the actors' boxes.
  BoxRefinement& boxes() { return boxes_; }
  const BoxRefinement& boxes() const { return boxes_; }

  bool has_actors() const { return params_.contains(std::string(kActorsPart) + "opacities"); }
  int64_t count(const char* part) const;
  /// Half the diagonal of a usual box, metres: the unit of actors' sizes.
  double actor_radius() const { return actor_radius_; }
  /// [G,1]: 1 for gaussians of actors, which come last.
  Tensor of_actors() const;
  /// For each of the actors' gaussians, the mean of those rows [A,...] that are its actor's.
  Tensor mean_of_actor(const Tensor& rows) const;
  /// Half the sizes of the boxes of the owners of actors' gaussians, [A,3].
  const Tensor& half_sizes() const { return half_sizes_; }
  /// Actors' gaussians, each in its box's axes.
  ThingsModel things(int degree) const;

  /// As a pinhole that moved sees them at a time, each actor in its own looks: what training compares. mirrored: for
  /// each actor, whether it is seen left for right in its box; empty: none.
  Projection projection(const View& view, const ViewMove& move, int degree,
                        const std::vector<bool>& mirrored = {}) const;
  /// [3,H,W] as the camera of that name has it: times a gain, plus an offset. Of all cameras the mean gain is 1 (of its
  /// logarithm 0), the mean offset 0.
  Tensor exposed(const Tensor& planes, const std::string& sensor) const;
  /// The three gains, then the three offsets.
  std::array<float, 6> exposure_of(const std::string& sensor) const;
  /// The sky's faces [6,S,S,3] become these.
  void put_sky(const Tensor& faces) { assign({{params_.at(kSkyName), faces}}); }
  const Tensor& sky_faces() const { return params_.at(kSkyName); }
  /// [3,P] in directions [P,3] of a camera that stands like this; differentiable in the sky alone.
  Tensor sky(const Tensor& directions, const Eigen::Matrix4d& world_from_camera) const {
    return sky_colours(params_.at(kSkyName), directions, world_from_camera);
  }

  /// Some gaussians, and whose they are: 1 + place of the actor, 0: the background.
  struct Shown {
    Projection projection;
    std::vector<int> actors;                // [G]
    std::optional<Projection> ground = {};  // lies behind all of them, as the sky does
  };
  /// As a pinhole sees the street with actors in the looks that they wear.
  Shown shown(const View& view) const;
  /// The gaussians of an actor alone in its box's axes.
  Shown alone(std::size_t actor, const Camera& camera, const Eigen::Matrix4d& box_from_camera) const;
  /// Those of one actor in its box's axes, in the middle of its time. like: what they have in common.
  Gaussians gaussians_of(std::size_t actor, const Gaussians& like) const;
  /// Place of an actor. Fault::data for a name that is none's.
  std::size_t place_of(const AssetName& asset) const;

 private:
  struct Standing {
    std::size_t actor;  // whose looks it has
    Eigen::Matrix4d world_from_box;
    double share;                                    // of the way from its first box to its last, in time
    std::array<BoxRefinement::Part, 2> corrections;  // of the boxes before and after
    bool mirrored = false;
  };
  Standing standing(std::size_t actor, const Eigen::Matrix4d& world_from_box, double time) const;
  Placements placements(const std::vector<Standing>& standing) const;
  /// Rows of those who stand there, one after the other; owners: places in `standing`.
  ThingsModel things_of(const std::vector<Standing>& standing) const;
  DrawOptions options() const { return {config_.near}; }

  const StreetGaussiansConfig& config_;
  Params& params_;
  std::vector<Actor> actors_;
  double actor_radius_ = 1;
  std::vector<std::string> sensors_;
  BoxRefinement boxes_;
  Params ground_;
  std::vector<int32_t> owners_;
  Tensor owner_rows_, half_sizes_;  // owners_ on the device, and of their boxes
};

}  // namespace cloam
