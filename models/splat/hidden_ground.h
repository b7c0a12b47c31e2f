// The ground that actors hide from all photos of a driving log: what stands there once an actor is moved or removed.
#pragma once
#include "models/splat/initial_street.h"

namespace cloam {

constexpr double kGroundSide = 0.5;  // metres

/// Flat, opaque gaussians, one for each cell of a grid of that side (metres) that photos have in view, none of them
/// without an actor before it. What lies beside a thing, but within its box's outline, may well be seen: boxes are
/// taken 0.2 m narrower on each side and 0.1 m lower, and must hide what is 0.2 m above the cell. Only actors hide
/// here: what is behind a house counts as seen, and photos from more than 60 m away do not count. z is up. Heights are
/// those of points nearby that LiDAR saw and that lie as high as actors stand, colours those of such points that some
/// photo shows; nothing is put where there are none within six metres. start: with its colours.
Gaussians hidden_ground(const std::vector<TimedPhoto>& photos, const Scene& scene, const StreetStart& start,
                        double side = kGroundSide);

/// Flat, opaque gaussians of cells: means [G,3], first coefficients of their colours [G,3].
Gaussians flat_gaussians(std::vector<float> means, std::vector<float> first, double side = kGroundSide);

}  // namespace cloam
