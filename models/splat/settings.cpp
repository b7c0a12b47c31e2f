// See settings.h.
#include "models/splat/settings.h"

#include <algorithm>

#include "models/gaussians/gaussians.h"

namespace cloam {

void bind_rates(Config& c, GaussianRates& r) {
  c.bind("train.rate_means", r.means, "learning rate of the means, relative to the cameras' radius");
  c.bind("train.final_means", r.final_means,
         "learning rate of the means at the last step, as a fraction of train.rate_means");
  c.bind("train.rate_first", r.first, "learning rate of the base colours");
  c.bind("train.rate_rest", r.rest, "learning rate of the view-dependent colours");
  c.bind("train.rate_opacities", r.opacities, "learning rate of the opacities");
  c.bind("train.rate_scales", r.scales, "learning rate of the scales");
  c.bind("train.rate_rotations", r.rotations, "learning rate of the rotations");
}

ParameterGroups gaussian_groups(const GaussianRates& rates, const std::string& prefix, double radius) {
  ParameterGroups groups = {{prefix + "means", rates.means * static_cast<float>(radius), {rates.final_means}},
                            {prefix + "scales", rates.scales},
                            {prefix + "rotations", rates.rotations},
                            {prefix + "opacities", rates.opacities},
                            {prefix + "sh_first", rates.first},
                            {prefix + "sh_rest", rates.rest}};
  for (ParameterGroup& group : groups) group.epsilon = 1e-15f;
  return groups;
}

void bind_harmonics(Config& c, HarmonicSteps& h) {
  c.bind("sh.degree", h.degree, "degree of the colours' spherical harmonics", {0, kSphericalBands});
  c.bind("sh.every", h.every, "steps before the next degree is used (at most a tenth of all steps)", kSteps);
}

int degree_at(const HarmonicSteps& harmonics, const Progress& progress) {
  int64_t every = harmonics.every;
  if (progress.horizon > 0) every = std::min(every, std::max<int64_t>(1, progress.horizon / 10));
  return static_cast<int>(std::min<int64_t>(harmonics.degree, progress.step / std::max<int64_t>(1, every)));
}

void bind_growth(Config& c, GrowthOptions& g) {
  c.bind("growth.strategy", g.strategy, "densify (the paper) or mcmc", {"densify", "mcmc"});
  c.bind("growth.start", g.from, "step after which the number of Gaussians may change", kStepsOrNone);
  c.bind("growth.every", g.every, "steps between changes of the number of Gaussians", kSteps);
  c.bind("growth.max", g.max_count, "largest number of Gaussians", {1, 1 << 28});
  c.bind("growth.gradient", g.gradient, "densify: mean gradient above which a Gaussian is cloned or split");
  c.bind("growth.absolute", g.absolute, "densify: sum the absolute gradients of the pixels (AbsGS)");
  c.bind("growth.split_scale", g.small,
         "densify: scale, relative to the cameras' radius, above which a Gaussian is split");
  c.bind("growth.prune_scale", g.large,
         "densify: scale, relative to the radius or its distance, above which a Gaussian is removed");
  c.bind("growth.prune_opacity", g.faint, "opacity below which a Gaussian is removed or moved", {0, 1});
  c.bind("growth.reset_every", g.reset_every, "densify: steps between resets of the opacities", kSteps);
  c.bind("growth.noise", g.noise, "mcmc: noise on the means, relative to their learning rate");
  c.bind("growth.weight_opacity", g.weight_opacity, "mcmc: weight of the mean opacity");
  c.bind("growth.weight_scale", g.weight_scale, "mcmc: weight of the mean scale");
}

}  // namespace cloam
