// Streets: a background in voxels, actors in boxes, the sky (ops/street.cpp; kernels/street.cl has the layouts).
#pragma once
#include <array>

#include "runtime/ops.h"

namespace cloam {

struct StreetGrid {
  Tensor cells;    // u8 [D,H,W]: is there anything
  Tensor blocks;   // u8: the same of blocks of 8^3, counts rounded up
  Tensor numbers;  // [16]: corner (3), voxel size, counts x y z, centre and half sizes (3 each) of what is not
                   // contracted, furthest distance of the sky
};
/// Where something stands at one moment; kernels read it as it lies.
struct StreetBox {
  std::array<float, 9> box_from_street;  // rotation, row by row
  std::array<float, 3> centre, half_size;
  float cube_scale;  // 0.5 / half side of the cube that the owner's planes fill
  float owner;       // its number, which a float holds exactly up to 2^24
};
struct StreetBoxes {
  Tensor first;  // int32 [M+1]: the boxes of moment m are first[m] up to first[m+1]
  Tensor boxes;  // [B, numbers of a StreetBox]; one that nobody meets where there are none
};
StreetBoxes pack_boxes(const std::vector<std::vector<StreetBox>>& moments);
struct StreetRays {
  Tensor origins, directions;  // [R,3] in the grid's axes, metres; directions of length 1
  Tensor jitter;               // [R,2] in [0,1): shifts of the background's and of actors' steps
  Tensor moments;              // int32 [R]
};
struct StreetSteps {
  float background = 0.3f, actor = 0.05f;  // metres
  int sky = 8;                             // samples behind the grid
  bool shadows = false;                    // also where rays meet the ground below boxes
};
/// Ray r owns places [offsets[r], offsets[r+1]) of t and rows, by distance. Samples lie in two lists: rows below
/// points.dim(0) are of the background, those from there on of actors.
struct StreetSamples {
  Tensor offsets, t, rows;                        // int32 [R+1], [S] (the sky's negative), int32 [S]
  Tensor points, ray;                             // background: [B,3] contracted to [0,1]^3, int32 [B]
  Tensor actor_points, actor_directions, owners;  // [A,3] in [0,1]^3 of the owner's cube, [A,3] in its box, int32 [A]
  Tensor shadow_offsets, shadow_points, shadow_directions, shadow_owners, shadow_t,
      shadow_ray;  // as offsets and actors
};
/// Runs at once (the number of samples is known only then); nothing is differentiable.
StreetSamples street_samples(const StreetRays& rays, const StreetBoxes& boxes, const StreetGrid& grid,
                             const StreetSteps& steps);
/// The samples that light reaches: those of each ray before its transmittance falls below `least`, and its last. alpha
/// [S] by row. At once.
StreetSamples street_lit(const StreetSamples& samples, const Tensor& alpha, float least);
/// int32 [R]: the owner that gives most light of a ray, if more than half, else -1. At once.
Tensor street_owners(const Tensor& alpha, const StreetSamples& samples);

}  // namespace cloam
