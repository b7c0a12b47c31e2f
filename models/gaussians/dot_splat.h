// .splat, what web viewers load (github.com/antimatter15/splat): 32 bytes a gaussian and nothing else. Three float32 of
// position, three of deviations, red green blue opacity as bytes, the rotation w x y z as bytes (128 is 0, 256 would be
// 1). Colours are the same from all sides; up is -y, as in the .ply files that it is made from.
#pragma once
#include <filesystem>

#include "models/gaussians/formats.h"

namespace cloam {

SplatFile read_dot_splat(const std::filesystem::path& path);
void write_dot_splat(const std::filesystem::path& path, const Gaussians& gaussians);

}  // namespace cloam
