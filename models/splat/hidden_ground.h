// The ground that actors hide from all photos of a driving log: what stands there once an actor is moved or removed.
#pragma once
#include "models/splat/street_photos.h"

namespace cloam {

/// Flat, opaque gaussians, one for each cell of a grid of that side (metres) that photos have in view, none of them
/// without an actor before it: what lies beside an actor, but within its box's outline, may well be seen, so boxes
/// count that are 0.2 m narrower on each side. z is up. Heights are those of the points nearby that lie as high as
/// actors stand, colours those of such points that some photo shows; nothing is put where there are none within six
/// metres. background: gaussians that begin on points that LiDAR saw, with their colours.
Gaussians hidden_ground(const std::vector<TimedPhoto>& photos, const Scene& scene, const Gaussians& background,
                        double side);

}  // namespace cloam
