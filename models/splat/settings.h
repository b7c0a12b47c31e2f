// Settings that trainings of gaussians share: rates, schedules, growth.
#pragma once
#include "models/splat/growth.h"
#include "models/train/config.h"
#include "models/train/parameter_groups.h"

namespace cloam {

struct GaussianRates {
  float means = 1.6e-4f;      // times the radius that they are spread over
  float final_means = 0.01f;  // factor reached at the horizon
  float first = 2.5e-3f, rest = 1.25e-4f, opacities = 0.05f, scales = 5e-3f, rotations = 1e-3f;
};
void bind_rates(Config& config, GaussianRates& rates);
/// Of the parameters that put_gaussians() names with that prefix. radius: of the cameras or the actors, scene units.
ParameterGroups gaussian_groups(const GaussianRates& rates, const std::string& prefix, double radius);

struct HarmonicSteps {
  int degree = 3;
  int every = 1000;  // steps between degrees, at most
};
void bind_harmonics(Config& config, HarmonicSteps& harmonics);
/// Of the harmonics that are learned at a step: a degree more each time; in a short training the last one shall still
/// be learned for most of it.
int degree_at(const HarmonicSteps& harmonics, const Progress& progress);

void bind_growth(Config& config, GrowthOptions& growth);

}  // namespace cloam
