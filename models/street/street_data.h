// What a driving log gives a training step: patches of its images and returns of its LiDAR, as rays in street axes.
#pragma once
#include "models/io/host_random.h"
#include "models/scene/lidar_points.h"
#include "models/scene/pixels.h"
#include "models/scene/view.h"
#include "models/street/street_space.h"

namespace cloam {

/// Rays side by side. A moment is a time that several of them share.
struct RayList {
  std::vector<float> origins, directions;  // [R,3], street axes, metres; directions of length 1
  std::vector<int32_t> moments;            // [R]
  std::vector<float> ranges;               // [R] metres to what a LiDAR saw; 0: a camera's ray
  std::vector<double> times;               // of the moments, seconds
  std::vector<bool> actors;                // which of Scene::actors the rays may meet; empty: all
  int64_t count() const { return static_cast<int64_t>(moments.size()); }
  void add(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, float range = 0);
};

/// Rays [begin, end) with all moments.
RayList part_of(const RayList& rays, int64_t begin, int64_t end);

/// A ray through the middle of each cell of scale x scale pixels of a view, row by row, cut cells too: ceil(W / scale)
/// x ceil(H / scale). A new moment.
void add_view(RayList& rays, const View& view, const StreetSpace& space, int scale);

class StreetData {
 public:
  /// `sweeps` are those of the training split, in memory. `scale`: pixels a ray. All must outlive this.
  struct LoadedSweep {
    const Sweep* sweep;
    LidarPoints points;
  };
  StreetData(const Scene& scene, Pixels pixels, std::vector<LoadedSweep> sweeps, int scale);

  /// The largest patch that fits every image, at most `wanted`; in rays.
  int64_t patch_side(int64_t wanted) const;
  /// `count` patches of side^2 rays, every second one (if it can be) around an actor, each a moment of its own. The
  /// images: [count,3,side scale,side scale] in [0,1]. Sets rays.actors to those that they or their shadows may show.
  Tensor add_patches(RayList& rays, const StreetSpace& space, HostRandom& random, int64_t count, int64_t side) const;
  /// One whole image, as far as it fills cells of scale^2 pixels; a moment. The image: [1,3,h scale,w scale]. Sets
  /// rays.actors as add_patches.
  Tensor add_image(RayList& rays, const StreetSpace& space, HostRandom& random) const;
  /// `count` returns of some sweeps, none of actors that rays.actors leaves out: each actor costs a decoding.
  void add_returns(RayList& rays, const StreetSpace& space, HostRandom& random, int64_t count) const;
  bool has_lidar() const { return !sweeps_.empty(); }
  size_t images() const { return pixels_.frames.size(); }
  std::vector<StreetSpace::Seen> seen() const;

 private:
  struct Region {
    int64_t x, y, columns, rows;  // in rays
  };
  struct Corner {
    int64_t x, y;
  };
  void mark_actors(RayList& rays, const FramePixels& photo, const Region& region) const;
  Corner corner_near_actor(const FramePixels& photo, HostRandom& random, int64_t side) const;
  /// Rays and colours of a region of a photo; colours go to `truth` [3,rows scale,columns scale].
  void add_region(RayList& rays, const StreetSpace& space, const FramePixels& photo, const Region& region,
                  float* truth) const;
  Corner random_corner(const FramePixels& photo, HostRandom& random, int64_t side) const;

  const Scene& scene_;
  Pixels pixels_;
  std::vector<LoadedSweep> sweeps_;
  int scale_;
};

}  // namespace cloam
