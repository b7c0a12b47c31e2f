// Where along rays a method samples, for people to look at.
#pragma once
#include "models/io/image.h"
#include "models/train/shows_samples.h"

namespace cloam {

/// A column for each ray, `width` of them, and a row for each step of the distance's logarithm: near is below, far
/// above; the ends are the nearest and the farthest sample (at most 1:1000). Blue where a sample gets no light, up to
/// white where all of the ray's light comes from; black where nothing is sampled.
Image sample_picture(const std::vector<RaySample>& samples, int width, int height);

}  // namespace cloam
