// Batches of the training images of a capture, which lie on the device: some pixels, as rays in normalised scene
// coordinates, or one whole photograph.
#pragma once
#include "models/io/share.h"
#include "models/render/rays.h"
#include "models/scene/learned_lenses.h"
#include "models/scene/photo_store.h"

namespace cloam {

struct PixelBatch {
  Rays rays;
  Tensor widths;  // [R] of pixels, at distance 1
  Tensor rgba;    // [R,4] in [0,1], straight alpha
  Tensor used;    // [R] 1, or 0 where a mask says ignore; empty when there are no masks
  Tensor depths;  // [R] how far along the ray, as its span; 0 where it is not known; empty when there are no depth maps
};

/// What is learned of photos in the place of what was given; empty handles: as given.
struct LearnedCameras {
  Tensor poses = {};          // [N,12] as PixelSource::poses()
  LearnedLenses lenses = {};  // of Scene::cameras
};

/// Squares of photos by their pixels in row-major order: of 4 a side, or of fewer that come more than once.
struct PixelSquares {
  Tensor places, side;  // int32 [R,16], [R]
};

/// All training pixels on the device.
class PixelSource {
 public:
  /// Fault::data for no image, Fault::memory for more than 2^29 pixels.
  PixelSource(const Scene& scene, const PhotoStore& photos, const SceneFrame& frame, const RayRange& range);
  /// The share of `count` pixels at random: a frame, then a pixel in it. streams key.stream and the two after it.
  /// Rays are differentiable in what is learned. coarse: the share of rays whose pixel is a square of 2x2 or 4x4 of the
  /// photos' pixels, as those of smaller photos are.
  PixelBatch draw(int64_t count, const RandomKey& key, const Share& share, const LearnedCameras& learned = {},
                  float coarse = 0) const;
  const Tensor& poses() const { return poses_; }

 private:
  struct Seen {
    Tensor directions, widths, rgba;  // camera axes
    Tensor used = {}, depths = {};    // as PixelBatch; depths along the optical axis
  };
  Seen single(const Tensor& pixel, const Tensor& direction) const;
  Seen squares(const Tensor& first_pixel, const Tensor& first_direction, const PixelSquares& at) const;

  SceneFrame frame_;
  RayRange range_;
  Tensor rgba_, mask_;  // [P,4], [P] uint8
  Tensor depth_;        // [P] along the optical axis, normalised
  Tensor directions_;   // [D,3] of length 1, camera axes
  Tensor widths_;       // [D] of pixels, at distance 1
  Tensor poses_;        // [N,12] rotation by rows, position (normalised)
  Tensor frames_;       // [N,5] int32: first pixel, pixels, first direction, camera, width
};

struct Photograph {
  Tensor rgba, mask;  // u8 [4,H,W], [H,W] (empty: all used)
  Tensor depth;       // [H,W] along the optical axis, scene units, 0 where it is not known; empty: nowhere
  Camera camera;
  Eigen::Matrix4d world_from_camera;
  int listed_camera = 0;  // index into Scene::cameras
};

/// All training photographs on the device.
class PhotoSource {
 public:
  /// Fault::data for no image.
  PhotoSource(const Scene& scene, const Pixels& pixels);
  const std::vector<Photograph>& photographs() const { return photographs_; }
  /// The place of a step's photograph, steps counted from 1. Ranks take turns in one order: every photograph once
  /// before any comes again.
  size_t draw(uint64_t seed, int64_t step, const Share& share) const;

 private:
  std::vector<Photograph> photographs_;
};

}  // namespace cloam
