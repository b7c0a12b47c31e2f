// Peak signal-to-noise ratio, -10 log10 of the mean squared error, for images with values in [0,1].
// Over a set of images it is taken per image and then averaged.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace cloam {

/// a, b: values of two images of one size in one layout -> decibel; infinite when equal. Fault::data when sizes differ.
double psnr(std::span<const float> a, std::span<const float> b);

/// a, b: [H,W,channels], mask: [H,W], pixels with a mask of 0 do not count. NaN when the mask is all 0.
double masked_psnr(std::span<const float> a, std::span<const float> b, std::span<const uint8_t> mask, int channels);

/// Mean value of each channel over all pixels of all images ([H,W,channels] each, of any size).
std::vector<double> mean_colour(std::span<const std::span<const float>> images, int channels);

/// The figure that a model must clear: mean PSNR of the test images against the mean colour of the training images.
double mean_colour_psnr(std::span<const std::span<const float>> train, std::span<const std::span<const float>> test,
                        int channels);

}  // namespace cloam
