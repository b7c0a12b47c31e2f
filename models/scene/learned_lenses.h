// What is learned of lenses in the place of what was given, on the device.
#pragma once
#include "runtime/ops.h"

namespace cloam {

/// As LensChange of camera.h has one; empty handles: as given.
struct LearnedLenses {
  Tensor focals = {};   // [C,1]: focal lengths over those given
  Tensor centres = {};  // [C,2]: shifts of principal points, in focal lengths given
  bool as_given() const { return !focals && !centres; }
};

/// Of [R] things their lenses. camera: int32 [R], rows of `lenses`.
LearnedLenses lenses_of(const LearnedLenses& lenses, const Tensor& camera);

/// Where [R,3] directions in camera axes, of lenses as given, point through those learned: one, or one for each.
Tensor directions_through(const LearnedLenses& lenses, const Tensor& directions);

/// Its inverse: [N,3,4] rows of camera_from_thing, so that a camera of the lens as given shows what one of the learned
/// lens does.
Tensor views_through(const LearnedLenses& lens, const Tensor& views);

}  // namespace cloam
