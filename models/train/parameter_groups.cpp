// See parameter_groups.h.
#include "models/train/parameter_groups.h"

#include <cmath>

#include "runtime/error.h"

namespace cloam {

float ParameterGroup::rate_at(const Progress& progress) const {
  const auto& [final_factor, decay_start, decay_steps, warm_up] = schedule;
  const auto step = static_cast<float>(progress.step);
  const float along = decay_steps > 0 ? step / static_cast<float>(decay_steps)
                                      : std::clamp((progress.fraction() - decay_start) / (1.f - decay_start), 0.f, 1.f);
  const float warm = warm_up > 0 ? std::min(1.f, step / static_cast<float>(warm_up)) : 1.f;
  // Another order of the factors changes the last bit, and with it the checkpoints of equal seeds.
  return rate * std::pow(final_factor, along) * warm;
}

const ParameterGroup& group_of(const std::string& name, const ParameterGroups& groups) {
  const ParameterGroup* best = nullptr;
  for (const ParameterGroup& group : groups)
    if (name.starts_with(group.prefix) && (!best || group.prefix.size() > best->prefix.size())) best = &group;
  if (!best) throw Error(Fault::internal, text("no parameter group is given for ", name));
  return *best;
}

}  // namespace cloam
