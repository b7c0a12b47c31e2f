// A run measured on photos: PSNR and SSIM on those held out, beside what trivial guesses score; of driving logs also
// over actors alone, and the LiDAR's depths.
#pragma once
#include <filesystem>

#include "models/eval/photos.h"
#include "models/eval/report.h"
#include "models/train/ranks.h"

namespace cloam {

/// Where the pictures of an evaluation go.
std::filesystem::path pictures_of(const EvalRequest& request);

/// Measures what is asked for and writes RUN/eval and the pictures; the record in memory may be given the place of
/// --data and the size of --downscale. Ranks share photos and sweeps, and all return the whole. Fault::usage for what
/// the run cannot be measured by, Fault::data where there is nothing to measure.
EvalResult measure_run(EvalRequest request, RestoredRun& run, const Listener& listener, const Ranks& ranks = alone());

}  // namespace cloam
