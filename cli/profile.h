// --profile and --profile-trace: what each kernel and each step cost, told when the command is done.
#pragma once
#include "cli/common.h"

namespace cloam {

/// Begins to record if the options ask for it. The device must be open.
void begin_profile(const Common& common);
/// Tells it on stderr and writes the trace. Nothing when no profile was begun. Fault::write.
void end_profile();

}  // namespace cloam
