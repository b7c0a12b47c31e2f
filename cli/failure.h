// Whatever was thrown, as the one error that the program tells.
#pragma once
#include "runtime/error.h"

namespace cloam {

/// Of the exception that is being handled: call it in a catch block. What is no Error becomes one: memory that the host
/// lacks (Fault::memory), else a bug (Fault::internal).
Error current_error();

}  // namespace cloam
