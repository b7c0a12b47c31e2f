// Intersection over union of outlines.
#pragma once
#include <cstddef>
#include <span>

namespace cloam {

/// shown, truth: the number of what each pixel shows, 0 for nothing, of two images of one size. For each number but 0
/// with `least` pixels or more in `truth`: pixels where both have it, over pixels where either has it; the mean of
/// these. NaN where there is no such number. Fault::data when sizes differ.
double mean_overlap(std::span<const int> shown, std::span<const int> truth, std::size_t least);

}  // namespace cloam
