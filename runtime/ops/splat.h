// Gaussian splats (ops/splat.cpp, ops/splat_project.cpp; kernels/splat*.cl have the formulas).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// 3D gaussians as training changes them, before exp, sigmoid and normalisation.
struct Cloud {
  Tensor means, scales, rotations, opacities;  // [G,3], [G,3], [G,4] (w, x, y, z: world_from_gaussian), [G]
};
/// A pinhole's numbers in pixels, and what is done beside the projection.
struct SplatCamera {
  float fx = 1, fy = 1, cx = 0, cy = 0;
  int64_t height = 0, width = 0;
  float near = 0.2f;         // gaussians whose centre is nearer are not seen
  float blur = 0.3f;         // square pixels, added to each covariance
  bool antialiased = false;  // opacities shrink by what the blur widens (Yu et al. 2024, Mip-Splatting)
};
/// view [3,4]: camera_from_world -> [G,7]: x, y in pixels, conic a, b, c (the inverse covariance (a b; b c)), opacity
/// (0 where it is not seen), depth along the camera's axis. Any number of times differentiable in the cloud and in
/// view; the composed form is its reference. With `owners` int32 [G] in [0,N), gaussians lie in the axes of N things:
/// view [N,3,4], camera_from_thing.
Tensor splat_project(const Cloud& cloud, const Tensor& view, const SplatCamera& camera, const Tensor& owners = {});
Tensor splat_project_composed(const Cloud& cloud, const Tensor& view, const SplatCamera& camera,
                              const Tensor& owners = {});
/// Colours towards an eye [3] from coefficients of spherical harmonics first [G,3] and rest [G,15,3], of degrees up to
/// `degree` (0 to 3): max(0, 0.5 + sum) -> [G,3]. Any number of times differentiable in all tensors; the composed
/// form is its reference. With owners as above: eye [N,3], in each thing's axes.
struct Harmonics {
  Tensor first, rest;
  int degree = 3;
};
Tensor splat_colours(const Harmonics& harmonics, const Tensor& means, const Tensor& eye, const Tensor& owners = {});
Tensor splat_colours_composed(const Harmonics& harmonics, const Tensor& means, const Tensor& eye,
                              const Tensor& owners = {});

/// What each tile of 16 x 16 pixels blends, front to back. Tiles row by row, those at the right and lower edge cut.
struct SplatTiles {
  Tensor ids;      // [P] int32 in [0,G): the gaussians of all tiles, one tile after another
  Tensor offsets;  // [tiles+1] int32
  Tensor slots;    // [P] int32: place of each pair when they are listed by gaussian
  Tensor first;    // [G+1] int32: where each gaussian's begin there
  int64_t height, width;
};
/// From the projection [G,7]: by tile, depth and number, each gaussian in the tiles where its alpha reaches 1/255. Runs
/// at once (the number of pairs is known only then); nothing is differentiable. Fault::usage for more than 2^31 pairs.
SplatTiles splat_tiles(const Tensor& seen, int64_t height, int64_t width);
struct SplatExtent {
  int64_t gaussians, height, width;
};
/// Lists that were made otherwise.
SplatTiles splat_lists(const Tensor& ids, const Tensor& offsets, const SplatExtent& extent);

struct Splats {
  Tensor seen;        // [G,7] of splat_project; the centre of the first pixel is (0.5, 0.5)
  Tensor colours;     // [G,C]: colours, depths, features
  Tensor probe = {};  // [G,2], never read: its gradient is the sum over pixels of |d loss / d x|, |d loss / d y|
};
struct Blended {
  Tensor image;          // [H,W,C]
  Tensor transmittance;  // [H,W]: what of the background is seen
};
/// 3D Gaussian Splatting's blending (Kerbl et al. 2023). Any number of times differentiable in the splats; the
/// gradients are the same bits each time. Up to five channels a pass. The composed form is its reference: 256 numbers a
/// pair in memory, and nothing for the probe, whose gradient is that of no function.
Blended splat_blend(const Splats& splats, const SplatTiles& tiles);
Blended splat_blend_composed(const Splats& splats, const SplatTiles& tiles);

}  // namespace cloam
