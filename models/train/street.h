// What methods that know actors and LiDAR can do beside pictures; and the view and the picture that all methods share.
#pragma once
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// Values [H,W,..] in [0,1] for colour; depth in scene units along the ray (0: nothing there).
struct Picture {
  int width = 0, height = 0;
  std::vector<float> rgb, depth, opacity;
  std::vector<int> actors;  // of methods with a Street: 1 + place in Scene::actors of the actor seen, 0: none
};

struct View {
  Camera camera;
  Eigen::Matrix4d world_from_camera;
  int scene = 0;    // of the run's scenes
  double time = 0;  // seconds on that scene's clock; where actors are
};

/// What a frame shows, with a camera of the size wanted.
inline View view_of(const Frame& frame, const Camera& camera, int scene) {
  return {camera, frame.world_from_camera, scene, frame.timestamp.value_or(0)};
}

/// Rays in the world frame of a scene; directions of length 1.
struct WorldRays {
  int scene = 0;
  double time = 0;
  std::vector<float> origins, directions;  // [R,3]
};

/// What a LiDAR would measure along rays, [R] each.
struct LidarReturns {
  std::vector<float> depths;  // metres; 0: nothing is hit
  std::vector<int> actors;    // as Picture::actors
};

/// A point cloud's worth of an asset, [N] and [N,3].
struct AssetSamples {
  std::vector<float> distances;  // signed, metres in scale, negative inside
  std::vector<float> colours;    // in [0,1], seen from where the surface faces
};

/// An asset that no log of the run shows: its latent code, of the shape that the run's own have, and the box that it
/// fills.
struct NewAsset {
  int asset_class = 0;  // of kAssetClasses
  bool night = false;   // what it was asked to look like
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  std::vector<float> code;  // [channels, side, side]
};

/// The name of the n-th asset (from 0) that a street of so many logs is given.
inline AssetName added_asset(std::size_t logs, std::size_t n) { return {static_cast<int>(logs + n), "generated"}; }

class Street {
 public:
  virtual ~Street() = default;
  virtual LidarReturns measure(const WorldRays& rays) = 0;
  /// The asset alone, on white. box_from_camera: the view in the axes of the actor's box (metres, origin its centre).
  virtual Picture render_asset(const AssetName& asset, const Camera& camera,
                               const Eigen::Matrix4d& box_from_camera) = 0;
  /// points [N,3] in the axes of the actor's box.
  virtual AssetSamples sample_asset(const AssetName& asset, const std::vector<float>& points) = 0;
  /// The name under which the asset can be shown from here on (added_asset); actors who have these looks wear them now,
  /// and the run's own stay as they are. Fault::usage for a street whose assets have no codes, Fault::data for a code
  /// of another size.
  virtual AssetName add_asset(const NewAsset& asset);
};

}  // namespace cloam
