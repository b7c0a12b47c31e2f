// Short loops of pictures that any viewer plays.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/io/image.h"

namespace cloam {

/// Frames of one size, RGB, played for ever. Colours are reduced to 256 a frame. Replaces `path` in one step.
/// comment: kept in the file as text; empty: none.
/// Fault::internal for no frames or several sizes; Fault::write.
void write_gif(const std::filesystem::path& path, const std::vector<Image>& frames, int frames_per_second,
               const std::string& comment = "");

}  // namespace cloam
