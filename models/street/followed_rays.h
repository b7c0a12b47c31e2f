// Samples along rays that move: where street_samples put them, as a function of the rays.
#pragma once
#include "runtime/ops/street.h"

namespace cloam {

/// The samples at the same distances along `rays`, of which they were made (street_samples, street_lit): points,
/// actor_points and actor_directions have the same values up to rounding, and are differentiable in the rays' origins
/// and directions. Samples of shadows stay as they are.
StreetSamples followed(const StreetSamples& samples, const StreetRays& rays, const StreetBoxes& boxes,
                       const StreetGrid& grid);

}  // namespace cloam
