// Structural similarity (Wang et al. 2004, doi 10.1109/TIP.2003.819861) with the choices of the Gaussian splatting
// papers: Gaussian window of 11x11 with sigma 1.5, zero padding, biased variances, mean over pixels and channels.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace cloam {

struct ImageShape {
  int height = 0, width = 0, channels = 0;
};

/// a, b: [H,W,C] with values in [0,1] -> similarity of each value, [H,W,C]. Fault::data when sizes and shape disagree.
std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, const ImageShape& shape);

/// Mean of the map; 1 for equal images.
double ssim(std::span<const float> a, std::span<const float> b, const ImageShape& shape);

/// Both images are painted black where mask [H,W] is 0; mean of the map over the rest. NaN when the mask is all 0.
double masked_ssim(std::span<const float> a, std::span<const float> b, std::span<const uint8_t> mask,
                   const ImageShape& shape);

}  // namespace cloam
