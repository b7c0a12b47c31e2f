// What a method must beat: the mean colour of the training images, shown everywhere.
#pragma once
#include <span>
#include <vector>

#include "models/metrics/psnr.h"

namespace cloam {

using Images = std::vector<std::vector<float>>;  // [H,W,3] each, of any size

inline std::vector<float> mean_colour(const Images& images) {
  std::vector<double> sums(3);
  double pixels = 0;
  for (const auto& image : images) {
    for (size_t i = 0; i < image.size(); ++i) sums[i % 3] += double{image[i]};
    pixels += static_cast<double>(image.size()) / 3;
  }
  for (double& sum : sums) sum /= pixels;
  return {sums.begin(), sums.end()};
}

/// The mean over the test images.
inline double mean_colour_psnr(const Images& train, const Images& test) {
  const std::vector<float> colour = mean_colour(train);
  double sum = 0;
  for (const auto& image : test) {
    std::vector<float> guess(image.size());
    for (size_t i = 0; i < guess.size(); ++i) guess[i] = colour[i % 3];
    sum += psnr(guess, image);
  }
  return sum / static_cast<double>(test.size());
}

}  // namespace cloam
