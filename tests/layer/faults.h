// Counting calls, making the n-th one fail, losing the device, hanging.
#pragma once
#include <CL/cl_icd.h>

namespace cloam::layer {

/// `below` with the functions of faults.cpp wrapped, as settings() ask.
cl_icd_dispatch with_faults(const cl_icd_dispatch& below);

}  // namespace cloam::layer
