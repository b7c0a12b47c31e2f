// Gaussians in the axes of things that move, seen where the things stand.
#pragma once
#include "models/splat/draw.h"
#include "runtime/ops/placing.h"

namespace cloam {

/// Gaussians of several things.
struct ThingsModel {
  SplatModel model;  // means and rotations in the axes of each one's thing, harmonics of directions there
  Tensor waves;      // [G,W,3]: amplitudes of the base colour's waves in time; empty: none
  Tensor owners;     // int32 [G]: the thing
};

/// Where N things are at a time.
struct Placements {
  Standings standings;
  Tensor heights;  // [N,W]: how far each wave is out then; empty: none
};

/// R v of unit quaternions [N,4], as the three columns of R one after the other: [N,3,3].
Tensor axes_of(const Tensor& turns);

/// As projection_of of a model in the world; differentiable in the model, in the shifts and turns of the
/// placements and in the camera's move.
Projection projection_of(const ThingsModel& things, const Placements& at, const Camera& camera, const Tensor& view,
                         const DrawOptions& options);

}  // namespace cloam
