// See ema.h.
#include "models/nn/ema.h"

#include <algorithm>

#include "runtime/ops.h"

namespace cloam {

double warm_decay(double decay, int64_t step) {
  const auto now = static_cast<double>(step);
  return std::min(decay, (1 + now) / (10 + now));
}

void update_ema(Params& ema, const Params& current, double decay) {
  std::vector<std::pair<Tensor, Tensor>> updates;
  for (auto& [name, mean] : ema)
    updates.push_back({mean, stop_gradient(mean) * decay + stop_gradient(current.at(name)) * (1 - decay)});
  assign(updates);
}

}  // namespace cloam
