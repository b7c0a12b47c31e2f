// A training of each method in the least sizes: what a step does stays, in some milliseconds on a CPU.
#pragma once
#include <filesystem>
#include <vector>

#include "tests/cli/process.h"

namespace cloam {

struct SmallTraining {
  const char* method;
  /// `train METHOD` into `run`, without pictures unless `more` asks for them; it names steps, checkpoints and the seed.
  Words (*words)(const std::filesystem::path& run, const Words& more);
};
const std::vector<SmallTraining>& small_trainings();

}  // namespace cloam
