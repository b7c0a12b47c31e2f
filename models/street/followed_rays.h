// Samples along rays and in boxes that move: where street_samples put them, as a function of the rays and the boxes.
#pragma once
#include "runtime/ops/street.h"

namespace cloam {

/// The samples at the same distances along `rays`, of which they were made (street_samples, street_lit): points,
/// actor_points and actor_directions have the same values up to rounding, and are differentiable in the rays' origins
/// and directions and in the boxes' axes and centres. Samples of shadows stay as they are.
StreetSamples followed(const StreetSamples& samples, const StreetRays& rays, const StreetBoxes& boxes,
                       const StreetGrid& grid);
/// The same of the samples in boxes alone: those of the background stay as they are.
StreetSamples followed_in_boxes(const StreetSamples& samples, const StreetRays& rays, const StreetBoxes& boxes);

}  // namespace cloam
