// CLOAM_DEBUG=kernels,nan,poison,bounds,sync,float64: switches read once at the start.
#pragma once

namespace cloam {

struct Debug {
  bool kernels = false;  // a line per launch, per plan and per kernel build
  bool nan = false;      // stop at the first op with a non-finite result
  bool poison = false;   // fresh buffers are filled with NaN
  bool bounds = false;   // buffers end at a guard page (CPU devices)
  bool sync = false;     // wait after each launch
  bool float64 = false;  // double in the place of float on the device (float64.h); version 1 of each op
};
const Debug& debug();

/// From now on evaluation by this thread stops at the first op with a NaN in its result (Fault::diverged, which names
/// the op), or no longer: how a training that diverged is searched. Infinite values, of which some ops make use, pass.
/// It is slow: each result is read back.
void look_for_nan(bool on);
bool looking_for_nan();

}  // namespace cloam
