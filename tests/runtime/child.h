// Runs one test case of this very program in a child process: for switches that are read once, and for outcomes that
// end a process.
#pragma once
#include <string>

namespace cloam {

/// What the child printed. `environment` is like "CLOAM_DEBUG=nan"; the case is one marked doctest::skip().
std::string output_of_child(const std::string& environment, const std::string& test_case);

}  // namespace cloam
