// Copies of codes, where they are plain to see.
#include "models/diffusion/code_figures.h"

#include <doctest/doctest.h>

using namespace cloam;

TEST_CASE("copies of codes: 0 for a copy, the ratio of medians else") {
  LabelledCodes training, copies, half;
  for (const float x : {0.f, 4.f, 8.f}) training.add({x, x}, 0);  // 4, 4 and 8 apart
  copies.add({4, 4}, 0);
  half.add({6, 6}, 0);
  CHECK(copy_ratio(copies, training) == 0);
  CHECK(copy_ratio(half, training) == doctest::Approx(2.0 / 4));
}
