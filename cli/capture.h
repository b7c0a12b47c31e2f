// A capture read and checked as a whole, before anything is made from it.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/data/load_images.h"
#include "models/train/run_folder.h"

namespace cloam {

struct Capture {
  Scene scene;
  Pixels train, test;
  std::vector<std::string> warnings;
};

/// The capture with its split; images are not read. Fault::data, Fault::usage.
Scene read_split_scene(const std::filesystem::path& data, const RunData& how);

/// Reads every image of both splits. Fault::memory, before reading, if they would not fit in `budget` bytes
/// (0: no limit).
Capture read_capture(const std::filesystem::path& data, const RunData& how, uint64_t budget);

/// Bytes of the loaded images (8-bit RGBA) of one split at a downscale.
uint64_t image_bytes(const Scene& scene, Split split, int downscale);

/// "50 images 1080x1920", "held out 7 (every 8th)", the lens, one line each.
std::vector<std::string> describe(const Scene& scene, const RunData& how);

}  // namespace cloam
