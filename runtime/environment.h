// The variables CLOAM_* that choose how kernels run. A value with a typing mistake is an error: without one the program
// would run as if the variable were not set, and nobody would know.
#pragma once

namespace cloam {

/// Fault::usage for a value that its variable cannot have, and for a folder of kernels that does not exist.
void check_environment();

}  // namespace cloam
