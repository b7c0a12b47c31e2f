// Chamfer distance of two sets of points.
#pragma once
#include <span>

namespace cloam {

/// Squared distances of points to the nearest point of the other set, summed up.
struct ChamferSums {
  double of_a = 0, of_b = 0;
  size_t count_a = 0, count_b = 0;

  /// (of_a + of_b) / count_b, as neurad-studio has it: b is the target.
  double by_target() const { return (of_a + of_b) / static_cast<double>(count_b); }
  /// The mean over a plus the mean over b.
  double symmetric() const { return of_a / static_cast<double>(count_a) + of_b / static_cast<double>(count_b); }
};

/// a, b: x y z of each point, [N,3] and [M,3]. Sums are infinite where the other set is empty. Fault::data for a number
/// of values that is no multiple of three, and for values that are not finite.
ChamferSums chamfer(std::span<const float> a, std::span<const float> b);

}  // namespace cloam
