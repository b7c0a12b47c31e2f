// Gaussians on the device, and what a camera sees of them.
#pragma once
#include <Eigen/Core>

#include "models/gaussians/gaussians.h"
#include "models/scene/camera.h"
#include "models/scene/learned_lenses.h"
#include "runtime/ops.h"
#include "runtime/ops/splat.h"

namespace cloam {

struct SplatModel {
  Cloud cloud;
  Harmonics harmonics;
};

/// As leaves that gradients reach.
SplatModel splat_model(const Gaussians& gaussians);

/// The rows [3,4] of camera_from_world.
Tensor view_matrix(const Eigen::Matrix4d& world_from_camera);

/// Where a camera stands and what lens it has, besides what was given; an empty handle: as given.
struct ViewMove {
  Tensor turned_back;  // [3,3], of a turn in the camera's axes, its inverse
  Tensor shift;        // [3,1] in the camera's axes, scene units, before the turn; there is both or neither
  LearnedLenses lens;  // [1,1] and [1,2]
  bool as_given() const { return !turned_back && lens.as_given(); }
};

struct DrawOptions {
  float near = 0.2f;         // scene units
  bool antialiased = false;  // see SplatCamera
  bool depth = false;        // a fourth channel: the sum of weights times z, scene units
  Tensor probe = {};         // see Splats
  Tensor more = {};          // [G,K]: channels besides
  ViewMove move = {};        // of the camera
};
/// Gaussians as a camera sees them, not yet drawn.
struct Projection {
  Tensor seen;  // [G,7] of splat_project
  Tensor rgb;   // [G,3]
};
struct Drawn {
  Tensor seen;  // [G,7] of splat_project
  SplatTiles tiles;
  Tensor planes;         // [C,H,W]: red, green, blue, on black; depth; those besides
  Tensor transmittance;  // [H,W]
};

/// [G]: whether some tile lists the gaussian, hidden or not.
Tensor listed(const SplatTiles& tiles);

/// What a moved camera sees of N things.
struct MovedViews {
  Tensor views;  // [N,3,4] of camera_from_thing, as splat_project takes them: with another lens no rotations
  Tensor eyes;   // [N,3] in the things' axes
};
/// views [N,3,4] of camera_from_thing as given.
MovedViews moved(const Tensor& views, const ViewMove& move);

/// As splat_project takes it.
SplatCamera lens_of(const Camera& camera, const DrawOptions& options);
Projection projection_of(const SplatModel& model, const Camera& camera, const Tensor& view, const DrawOptions& options);
/// The gaussians of both, those of `a` first.
Projection together(const Projection& a, const Projection& b);
/// The projection is evaluated at once: which tiles the gaussians reach depends on it.
Drawn draw(const Projection& projection, const Camera& camera, const DrawOptions& options);

/// A pinhole's picture (Kerbl et al. 2023); differentiable in the model and in `view`, of view_matrix.
Drawn draw(const SplatModel& model, const Camera& camera, const Tensor& view, const DrawOptions& options);

}  // namespace cloam
