// A made street of three steps and a run that learnt it for a moment, each made once for all tests.
#pragma once
#include <filesystem>

namespace cloam {

const std::filesystem::path& small_street();
/// genassets in the least sizes; its first step is held out.
const std::filesystem::path& small_street_run();

}  // namespace cloam
