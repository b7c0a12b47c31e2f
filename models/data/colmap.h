// Captures with a sparse model of COLMAP's beside their images. World axes and scale are the model's.
#pragma once
#include <filesystem>
#include <string>

#include "models/data/reader.h"

namespace cloam {

bool is_colmap(const std::filesystem::path& root);

/// The model in sparse/0, sparse or the folder itself; images in images/ or, where there is no such folder, in the
/// folder itself. Frames are sorted by name. Listed images that do not exist are skipped with one warning; points that
/// are not finite or were found in no image are left out, with one. Up is the mean of the cameras'. Fault::data for
/// anything else that is wrong (with options.skip_bad, a wrong image is dropped with a warning).
Scene read_colmap(const std::filesystem::path& root, const ReadOptions& options);

/// How well the model's points meet the places in the images where they were found.
struct ColmapFit {
  std::size_t points = 0, observations = 0;
  double mean_error = 0;  // pixels, over the observations
};

/// "0.73 px", or "not known" where no point was seen.
std::string error_in_words(const ColmapFit& fit);

/// Fault::data as read_colmap.
ColmapFit check_colmap(const std::filesystem::path& root);

}  // namespace cloam
