// .ply as 3D Gaussian Splatting writes it (github.com/graphdeco-inria/gaussian-splatting): vertices with x y z, nx ny
// nz (0), f_dc_0 to 2, f_rest_0 to 44 (all of red, then of green, then of blue; 0, 9 or 24 of them where the degree is
// lower), opacity, scale_0 to 2, rot_0 to 3: raw values, float32. Ours say in comments of the header which way is up
// and what a unit is: "up 0 -1 0", "unit metre".
#pragma once
#include <filesystem>

#include "models/gaussians/formats.h"
#include "models/io/commit.h"

namespace cloam {

/// What our comments say of the way up and the unit; without them, -y is up.
void take_comments(const std::vector<std::string>& comments, Gaussians& gaussians);
std::vector<std::string> comments_of(const Gaussians& gaussians);

/// A compressed .ply too (compressed_ply.h). Properties in any order, others beside them. Vertices without f_dc_0 are
/// points (x y z, with or without red green blue): they become gaussians as training begins with. Without our comment,
/// -y is up.
SplatFile read_gaussian_ply(const std::filesystem::path& path);

/// In the world's own axes, every value with all its bits; the degree is the least that holds all coefficients.
void write_gaussian_ply(const std::filesystem::path& path, const Gaussians& gaussians);
/// The bytes of that file, part by part.
void write_gaussian_ply(const Gaussians& gaussians, const ByteSink& sink);

}  // namespace cloam
