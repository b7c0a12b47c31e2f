// Exponential moving averages of parameters: what is sampled from moves less than what is trained.
#pragma once
#include "models/nn/params.h"

namespace cloam {

/// decay, but less in the first steps (counted from 1), so that the initial values are soon forgotten:
/// min(decay, (1 + step) / (10 + step)).
double warm_decay(double decay, int64_t step);

/// ema <- decay * ema + (1 - decay) * current, in place, for all names of `ema`, which `current` has too.
void update_ema(Params& ema, const Params& current, double decay);

}  // namespace cloam
