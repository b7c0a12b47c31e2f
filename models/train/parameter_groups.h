// Where a training stands, and how its parameters are learned: groups of them with a rate, a schedule and Adam's
// constants each.
#pragma once
#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "models/io/share.h"

namespace cloam {

/// Where training stands. horizon: the number of steps that schedules are stretched over (0 until it is chosen). A
/// training that was finished can go on beyond it, at their final values.
struct Progress {
  int64_t step = 0;  // 1 is the first
  int64_t horizon = 0;
  uint64_t seed = 0;
  Share share = {};  // of each step's batch
  /// 0 at the start, 1 from the horizon on; 0 as long as no horizon is chosen.
  float fraction() const {
    return horizon > 0 ? std::min(1.f, static_cast<float>(step) / static_cast<float>(horizon)) : 0.f;
  }
};

/// The learning rate schedule: a linear warm-up, constant, then exponential decay to `final_factor` at the horizon.
struct LearningRateSchedule {
  float final_factor = 1;
  float decay_start = 0;    // share of the horizon before the decay
  int64_t decay_steps = 0;  // not 0: the decay takes so many steps from the first on, whatever the horizon, and goes on
  int warm_up = 0;          // steps
};

/// The parameters whose names begin with `prefix` (of several groups the one with the longest).
struct ParameterGroup {
  std::string prefix;
  float rate = 1e-3f;
  LearningRateSchedule schedule = {};
  float beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-8f;  // of Adam
  bool sparse = false;                                  // rows without a gradient stand still and count their own steps
  bool frozen = false;                                  // never changed: no gradient, no optimiser state
  float decay = 0;                                      // AdamW's weight decay
  /// The learning rate at a step.
  float rate_at(const Progress& progress) const;
};
using ParameterGroups = std::vector<ParameterGroup>;

/// The group that a parameter belongs to. Fault::internal if there is none.
const ParameterGroup& group_of(const std::string& name, const ParameterGroups& groups);

}  // namespace cloam
