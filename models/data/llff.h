// LLFF's captures (Mildenhall et al., Local Light Field Fusion, 2019): photos that all look one way, with the poses and
// the depths of what they see in one array, poses_bounds.npy.
#pragma once
#include <filesystem>

#include "models/data/reader.h"

namespace cloam {

bool is_llff(const std::filesystem::path& root);

/// Row i belongs to the i-th image by name of images/ or, without it, of the first of images_2/, images_4/ and
/// images_8/. Poses and scale are the file's. Fault::data naming what is wrong.
Scene read_llff(const std::filesystem::path& root, const ReadOptions& options);

/// The least depth in poses_bounds.npy, for captures whose poses are read from elsewhere. Fault::data as read_llff.
double llff_nearest(const std::filesystem::path& root);

}  // namespace cloam
