// Short loops of pictures that any viewer plays.
#pragma once
#include <filesystem>
#include <vector>

#include "models/io/image.h"

namespace cloam {

/// Frames of one size, RGB, played for ever. Colours are reduced to 256 a frame. Replaces `path` in one step.
/// Fault::internal for no frames or several sizes; Fault::write.
void write_gif(const std::filesystem::path& path, const std::vector<Image>& frames, int frames_per_second);

}  // namespace cloam
