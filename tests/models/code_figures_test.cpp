// Copies and classes of codes, where both are plain to see.
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

TEST_CASE("classes of codes: by the nearest of two means of each class") {
  LabelledCodes training, samples;
  for (const float x : {0.f, 0.4f, 10.f, 10.4f}) training.add({x, 2}, 2);  // their one mean is among those of class 7
  for (const float x : {4.f, 6.f}) training.add({x, 2}, 7);
  samples.add({1.5f, 2}, 2);
  samples.add({9, 2}, 2);
  samples.add({4.8f, 2}, 7);
  samples.add({5.2f, 2}, 2);  // wrong
  samples.add({9, 2}, 7);     // wrong
  CHECK(share_of_right_classes(samples, training) == 0.6);
  CHECK(share_of_right_classes(training, training) == 1);
}
