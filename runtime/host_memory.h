// How much memory the host can still give.
#pragma once
#include <cstdint>

namespace cloam {

/// Bytes that are free or can be made so (MemAvailable), or that the process's control group has left, whichever is
/// less.
uint64_t host_free_bytes();

}  // namespace cloam
