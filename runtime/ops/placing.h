// Things that stand somewhere for a moment, and how their gaussians look then (ops/placing.cpp).
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// Where N things stand: each at its given pose, moved and turned by what is known of two rows of a table.
struct Standings {
  Tensor poses;          // [N,3,4]: world_from_thing as given
  Tensor shifts, turns;  // [B,3] along the thing's axes, scene units; [B,1] about its z axis, radians
  Tensor rows, shares;   // int32 [N,2] in [0,B), [N,2]: which rows, and how much of each
  Tensor sides;          // [N]: 1, or -1 for a thing that is seen mirrored, its x axis turned round
};
/// view [3,4]: camera_from_world -> [N,15]: camera_from_thing [3,4] row by row, then the eye in the thing's axes. Any
/// number of times differentiable in shifts and turns, in nothing else; the composed form is its reference.
Tensor place_things(const Standings& things, const Tensor& view);
Tensor place_things_composed(const Standings& things, const Tensor& view);

/// Waves in time of what gaussians of N things have: amplitudes [G,W,C = 3], heights [N,W] of each thing's waves now,
/// owners int32 [G] in [0,N).
struct Waves {
  Tensor amplitudes, heights, owners;
};
/// first [G,3] + the sum of its waves -> [G,3]. Any number of times differentiable in first and amplitudes, in nothing
/// else; the composed form is its reference.
Tensor add_waves(const Tensor& first, const Waves& waves);
Tensor add_waves_composed(const Tensor& first, const Waves& waves);

}  // namespace cloam
