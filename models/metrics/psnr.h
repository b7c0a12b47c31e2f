// Peak signal-to-noise ratio, -10 log10 of the mean squared error, for images with values in [0,1].
// Over a set of images it is taken per image and then averaged.
#pragma once
#include <cstdint>
#include <span>

namespace cloam {

/// Decibel; infinite for an error of 0.
double psnr_of_error(double mean_squared_error);

/// a, b: values of two images of one size in one layout -> decibel; infinite when equal. Fault::data when sizes differ.
double psnr(std::span<const float> a, std::span<const float> b);

/// a, b: [H,W,channels], mask: [H,W], pixels with a mask of 0 do not count. NaN when the mask is all 0.
double masked_psnr(std::span<const float> a, std::span<const float> b, std::span<const uint8_t> mask, int channels);

}  // namespace cloam
