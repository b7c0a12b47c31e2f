// CLOAM_DEBUG=float64: the same graph with 64-bit floating point on the device, to tell rounding from wrong results.
#pragma once
#include <string>

namespace cloam {

/// A kernel's text with double in the place of float: types, literals, conversions and infinities. Kernels stay as they
/// are written; what depends on the bits of a float has a branch of its own (CLOAM_FLOAT64, kernels/prelude.cl).
std::string in_float64(const std::string& source);

}  // namespace cloam
