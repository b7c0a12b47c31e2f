// PlayCanvas's compressed .ply (github.com/playcanvas/splat-transform), which SuperSplat writes as .compressed.ply:
// after the header the bounds of chunks of 256 gaussians in a row, then four words a gaussian, whose parts of 8 to 11
// bits lie between the bounds of its chunk, then bytes of harmonics.
#pragma once
#include <cstddef>
#include <filesystem>
#include <vector>

#include "models/gaussians/formats.h"

namespace cloam {

/// Whether the file begins as one; false also where there is no such file.
bool is_compressed_ply(const std::filesystem::path& path);

/// Chunks with and without bounds of colours. Comments as gaussian_ply.h has them. Fault::data for a damaged file.
SplatFile read_compressed_ply(const std::filesystem::path& path);

/// In the world's own axes, in compressed_order. Harmonics lie between -4 and 4, in steps of 1/32, of which none is 0.
/// Fault::data for values that are not finite; Fault::write.
void write_compressed_ply(const std::filesystem::path& path, const Gaussians& gaussians);

/// The places of the gaussians in the order of the file: along a curve that fills space (Morton's), so that the chunks
/// are small.
std::vector<std::size_t> compressed_order(const Gaussians& gaussians);

}  // namespace cloam
