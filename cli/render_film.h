// Pictures of a path become a film where ffmpeg is installed.
#pragma once
#include <filesystem>
#include <string>

#include "cli/common.h"

namespace cloam {

/// FOLDER/NAME.mp4 of the pictures FOLDER/NAME_0000.png to `count`, of even width and height: an odd last column or row
/// is left out. False where ffmpeg is not in PATH (a line says so) and where it fails (a warning with its last words);
/// Fault::write where the disk is full.
bool write_film(const std::filesystem::path& folder, const std::string& name, std::size_t count, int frames_per_second,
                const Common& common);

}  // namespace cloam
