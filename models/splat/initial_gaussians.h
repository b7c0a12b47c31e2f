// Where a training of gaussians begins.
#pragma once
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "models/scene/actor_space.h"
#include "models/scene/pixels.h"
#include "models/splat/growth.h"

namespace cloam {

struct InitialOptions {
  std::string kind = "auto";  // auto | points | lidar | depths | random | the path of a file, in the capture's world
  int random = 20000;         // how many points are drawn, or kept of LiDAR's and of depth maps
  uint64_t seed = 0;
  bool depths = false;  // photos come with their depth maps
};

struct InitialGaussians {
  Gaussians gaussians;
  bool grey = false;         // nobody knows their colours yet: ask the photos
  bool from_depths = false;  // none yet but one to stand for them: ask the photos (points_from_depths)
};

Eigen::Vector3d mean_of(const Gaussians& gaussians, std::size_t i);

/// At the origin: what stands for those that are yet to come.
Gaussians one_gaussian();

/// points: those that came with the capture; lidar: of the sweeps that train, without those in the boxes of actors that
/// move, and a tenth more on a dome for the sky, grey; depths: of the photos' depth maps; random: in the region that
/// the cameras see in common, grey; auto: the first of these that there is; a file's as they are. Fault::usage for an
/// unknown kind, Fault::data for points, sweeps or depth maps that the capture does not have.
InitialGaussians initial_gaussians(const Scene& scene, const InitialOptions& options);

/// A photo that trains, through a pinhole.
struct PosedPhoto {
  const FramePixels& pixels;
  const Camera& camera;
  Eigen::Matrix4d world_from_camera;
};

/// The number of the pixel, row by row, where a photo shows a point, whatever is before it; none: the point is out of
/// its image, or the pixel is transparent or masked.
std::optional<std::size_t> pixel_that_shows(const PosedPhoto& photo, const Eigen::Vector3d& point);

/// The colour that the photo which shows a point from nearest by has there.
class NearestColour {
 public:
  /// actors: those that may stand before the point. Where one does, the photo does not show it.
  void look(const PosedPhoto& photo, const Eigen::Vector3d& point, const ActorSpace& actors = {});
  /// The gaussian's base colour; as it is where no photo showed the point.
  void put(Gaussians& gaussians, std::size_t i) const;
  bool found() const { return std::isfinite(distance_); }

 private:
  double distance_ = std::numeric_limits<double>::infinity();
  std::array<float, 3> first_{};
};

/// Whether the frame's camera has the point in its image, whatever is before it.
bool sees(const Scene& scene, const Frame& frame, const Eigen::Vector3d& point);

/// Of the rows in [first, last), those that no photo shows take on the mean colour of those that are seen, and count as
/// seen; nothing happens where none is.
void colour_unseen(Gaussians& gaussians, std::vector<char>& is_seen, std::size_t first, std::size_t last);

/// Each gaussian takes the colour of its pixel in the nearest photo that shows its mean; where none does, the mean
/// colour of the others.
void colour_from(const std::vector<PosedPhoto>& photos, Gaussians& gaussians);

/// What the pixels of depth maps show, evenly picked, `most` of them at the most, with their colours. Fault::data where
/// none has a depth.
PointCloud points_from_depths(const std::vector<PosedPhoto>& photos, int most);

/// Of the photos that train; a radius of 1 for cameras in one place.
CameraRegion camera_region(const Scene& scene);

}  // namespace cloam
