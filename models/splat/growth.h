// How the number of gaussians follows what the pictures need: two strategies behind one interface.
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "models/gaussians/gaussians.h"
#include "models/train/parameter_groups.h"
#include "runtime/ops.h"
#include "runtime/ops/splat.h"

namespace cloam {

struct GrowthOptions {
  std::string strategy = "densify";  // densify | mcmc
  int from = 500, every = 100;       // steps: none changes before or at the first
  int max_count = 1000000;           // gaussians
  float gradient = 2e-4f;            // densify: |d loss / d mean| in units of half the picture that asks for more
  bool absolute = false;   // densify: absolute values pixel by pixel (Ye et al. 2024, AbsGS); 8e-4 is usual then
  float small = 0.01f;     // densify: of the cameras' radius; larger gaussians are split, others doubled
  float large = 0.1f;      // densify: of the radius, or of the distance from the cameras' middle where that is more;
                           // larger ones go after the first reset
  float faint = 0.005f;    // opacity below which a gaussian goes (mcmc: moves)
  int reset_every = 3000;  // densify: steps between resets of opacities
  float noise = 5e5f;      // mcmc: times the rate of means
  float weight_opacity = 0.01f, weight_scale = 0.01f;  // mcmc
};

/// Where the cameras are: the unit of sizes, and what far things are far from. Scene units.
struct CameraRegion {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  double radius = 1;  // 3DGS's extent: 1.1 times the largest distance of a camera from their middle
};

/// What the views of the last steps said about each gaussian.
struct GrowthStatistics {
  std::vector<float> gradients;  // [G] mean of |d loss / d mean| over the views that saw it, units of half the picture
};

/// Where a row came from, and whether its optimiser state begins anew.
struct GrowthMoves {
  std::vector<int32_t> source;  // [G'] row before, of the moments too; -1: new moments
  std::vector<int32_t> parent;  // [G'] row before, that it is or is made of
  bool opacities_reset = false;
  bool any() const { return !source.empty() || opacities_reset; }
};

class Growth {
 public:
  virtual ~Growth() = default;
  /// Changes the gaussians after a step, if the step is one for that.
  virtual GrowthMoves grow(Gaussians& gaussians, const GrowthStatistics& statistics, const Progress& progress) = 0;
  /// Whether grow() wants to be called after this step.
  virtual bool due(const Progress& progress) const = 0;
  /// The last step at which it may, of a training with that horizon.
  virtual int64_t until(const Progress& progress) const = 0;
  /// Added to the loss; an empty handle for none.
  virtual Tensor penalty(const Cloud&) const { return Tensor(); }
  /// What is added to the means after each step; an empty handle for nothing. `rate`: of the means at this step.
  virtual Tensor shift(const Cloud&, const Progress&, float /*rate*/) const { return Tensor(); }
};

/// Fault::usage for an unknown strategy.
std::unique_ptr<Growth> make_growth(const GrowthOptions& options, const CameraRegion& cameras);

/// The opacity and the factor on the deviations of each of `count` gaussians that together look like one of that
/// opacity (Kheradmand et al. 2024, 3DGS as MCMC, eq. 9).
struct Shared {
  double opacity, scale;
};
Shared shared_among(double opacity, int count);

}  // namespace cloam
