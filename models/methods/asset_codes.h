// The latent codes that a run of genassets learned, as the data of methods that learn from them.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "models/train/learns_from_run.h"

namespace cloam {

/// Of codes at the start: parameters hold what is added to it.
constexpr float kCodeLogVariance = -6;

/// Of A actors of all logs. means, deviations: [A, channels, side, side]; deviations empty where codes are plain.
struct AssetCodes {
  int64_t channels = 0, side = 0;
  std::vector<float> means, deviations;
  std::vector<int32_t> classes, nights;  // asset_class.h; 1: its log is of the night
  std::vector<Eigen::Vector3d> sizes;    // of their boxes, metres
  int64_t unseen = 0;                    // actors that are left out: fewer than `least_steps` steps trained them
  std::size_t count() const { return classes.size(); }
};

/// Side and channels of the codes, as settings of genassets say. Fault::data for a run of another method, an edited
/// one, and one whose actors have no codes.
struct CodeShape {
  int64_t channels, side;
  bool variational;
};
CodeShape code_shape(const SourceRun& source);

/// Fault::data for what does not fit together, and for runs of no actor that was seen.
AssetCodes asset_codes(const SourceRun& source, int64_t least_steps);

}  // namespace cloam
