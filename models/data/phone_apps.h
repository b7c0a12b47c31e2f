// Exports of apps that scan with a phone: Polycam's raw data and Record3D's "EXR + RGB". Their poses are ARKit's:
// metres, y up, camera axes x right, y up, z back.
#pragma once
#include "models/data/reader.h"

namespace cloam {

/// keyframes/cameras/NAME.json beside keyframes/images/NAME.jpg; corrected_cameras/ and corrected_images/, which
/// Polycam adds once it has aligned them, are taken instead where they are. Depths are keyframes/depth/NAME.png,
/// without those that keyframes/confidence/NAME.png calls low.
bool is_polycam(const std::filesystem::path& root);
Scene read_polycam(const std::filesystem::path& root, const ReadOptions& options);

/// EXR_RGBD/metadata.json, EXR_RGBD/rgb/N.jpg (or .png) and EXR_RGBD/depth/N.exr, or the same without EXR_RGBD/.
bool is_record3d(const std::filesystem::path& root);
Scene read_record3d(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
