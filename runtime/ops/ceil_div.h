// How many blocks cover a length.
#pragma once
#include <cstdint>

namespace cloam {

/// a / b, rounded up; a at least 0, b at least 1.
inline int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

}  // namespace cloam
