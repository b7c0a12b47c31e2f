// Independent pieces of work on all cores.
#pragma once
#include <cstddef>
#include <functional>

namespace cloam {

/// Calls work(0) ... work(count - 1) once each, on as many threads as there are cores, this one among them. What one
/// throws ends it: no further piece begins, and the failure of the lowest number is thrown, which is the one that a
/// loop would meet, since pieces begin in order.
void in_parallel(std::size_t count, const std::function<void(std::size_t)>& work);

}  // namespace cloam
