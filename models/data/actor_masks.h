// Which actor each pixel of a log's image shows.
#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

#include "models/scene/pixels.h"
#include "models/scene/scene.h"

namespace cloam {

/// actors [H,W]: 1 + place in Scene::actors of the actor seen, 0: none.
struct ActorMask {
  int width = 0, height = 0;
  std::vector<int> actors;

  /// [H,W], 255 where any actor is seen: as the metrics take it.
  std::vector<std::uint8_t> any() const;
  /// The same of those of the scene's actors that go somewhere (scene.h).
  std::vector<std::uint8_t> moving(const Scene& scene) const;
};

/// Masks of one log, exact where it has truth beside it: truth/CAMERA/NN_actor.png (instance numbers, 8 or 16 bit, 0
/// none) and truth/actors.json, which maps them to the ids of actors. Only actors with a box at the frame's step count
/// (in PandaSet's logs those further away have none). In frames without truth the outlines of the boxes stand for them,
/// the nearest in front.
class ActorMasks {
 public:
  /// Without use_truth the boxes are taken in any case. Fault::data for an actors.json that is damaged.
  explicit ActorMasks(const Scene& scene, bool use_truth = true);
  /// Masks from elsewhere, such as a segmentation network: folder/actors.json as above, folder/CAMERA/NN_actor.png for
  /// the image NN of that camera. Fault::data where there is no actors.json.
  static ActorMasks from(const Scene& scene, const std::filesystem::path& folder);
  /// Whether a file says what the frame shows; else the boxes do.
  bool has_truth(const Frame& frame) const;
  /// camera: of the image as loaded; masks of truth are reduced to its size, where a pixel counts if most of those it
  /// stands for do. Fault::data, naming the file, if its size does not fit.
  ActorMask of(const Frame& frame, const Camera& camera) const;

 private:
  void read_numbers(const std::filesystem::path& path);
  std::filesystem::path mask_file(const Frame& frame) const;
  ActorMask read(const Frame& frame, const Camera& camera) const;

  const Scene& scene_;
  bool use_truth_ = false;
  std::filesystem::path folder_;  // of masks from elsewhere; empty: those of the truth
  std::map<int, int> numbers_;    // instance number -> 1 + place of the actor
};

/// Of each photo: [height/cell,width/cell] the share of a cell's pixels that show an actor; empty where no file says
/// it.
std::vector<std::vector<float>> actor_shares(const Scene& scene, const Pixels& photos, int cell);

struct PlacedBox {
  int actor = 0;  // 1 + place in Scene::actors
  Eigen::Vector3d size;
  Eigen::Matrix4d world_from_box;
};
/// The first actor whose box each pixel's ray meets.
ActorMask outlines(const std::vector<PlacedBox>& boxes, const Camera& camera, const Eigen::Matrix4d& world_from_camera);

}  // namespace cloam
