// Smooth noise, patterns and colours for things that are made by rule: equal on every platform.
#pragma once
#include <Eigen/Core>

#include "models/io/host_random.h"

namespace cloam {

/// A value in [0,1) for each place of the whole numbers.
double lattice_value(int x, int y, int z);
/// Smooth noise in [0,1] with features of about one unit.
double noise(const Eigen::Vector3d& p);

/// What part of [x - width / 2, x + width / 2] lies in the pulses [k period, k period + pulse), k whole: a pattern of
/// stripes that turns into its mean where a pixel covers many of them.
double stripes(double x, double period, double pulse, double width);

/// What part of [x - width / 2, x + width / 2] lies in [low, high].
double inside(double x, double low, double high, double width);

Eigen::Vector3d mix(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double t);

/// Linear brightness to the sRGB curve; clamped to [0,1].
double srgb(double linear);

}  // namespace cloam
