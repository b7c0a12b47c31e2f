// A made street of three steps and a run that learnt it for a moment, each made once for all tests.
#pragma once
#include <filesystem>

#include "tests/cli/process.h"

namespace cloam {

const std::filesystem::path& small_street();
/// genassets in the least sizes; its first step is held out.
const std::filesystem::path& small_street_run();

/// genassets of two streets, one of them at night, that has seen most of its actors; there is matter in them.
const std::filesystem::path& two_streets_run();
/// Eight steps leave space empty: matter wherever the field begins, for what needs a surface.
void give_surfaces(const std::filesystem::path& checkpoint);
/// `train diffusion` on the run `source` into `run`, in the least sizes; without pictures, unless `more` says
/// --pictures.
Words small_diffusion(const std::filesystem::path& source, const std::filesystem::path& run, const Words& more = {});
const Words kDiffusionSteps = {"--steps", "60", "--save-every", "20"};
/// What that makes of two_streets_run() when it is left alone.
const std::filesystem::path& small_diffusion_run();

}  // namespace cloam
