// .spz, versions 2 and 3 (github.com/nianticlabs/spz): gzip around a header of 16 bytes and one section a quantity, in
// about 20 bytes a gaussian of degree 0 and 64 of degree 3. Axes are OpenGL's: y is up.
#pragma once
#include <filesystem>

#include "models/gaussians/formats.h"

namespace cloam {

/// Also without the gzip. Version 4 (zstd) and others are Fault::data by their number. Coefficients of degree 4 are
/// left out with a warning.
SplatFile read_spz(const std::filesystem::path& path);

/// Rounded as Niantic's library does: opacity, colours and deviations to a byte, harmonics of degree 1 to 5 bits and of
/// degrees 2 and 3 to 4 bits; positions to 2^-16 or what the farthest one leaves of 24 bits. Rotations
/// are kept to a quarter of a degree in version 3, in version 2 to 13 degrees where w is near 0 and else to one.
/// Fault::usage for other versions, Fault::data for a position beyond 2^23.
void write_spz(const std::filesystem::path& path, const Gaussians& gaussians, int version = 3);
/// The bytes of that file, whose axes turn_between (turn.h) takes from `up` to y; `name` stands at the head of errors.
std::vector<std::uint8_t> spz_bytes(const Gaussians& gaussians, int version, const std::string& name);

}  // namespace cloam
