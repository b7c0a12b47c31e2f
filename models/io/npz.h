// Archives of arrays as numpy.savez and savez_compressed write them: a zip file with a .npy for each array.
#pragma once
#include <filesystem>
#include <span>

#include "models/io/safetensors.h"

namespace cloam {

/// Does it begin as a zip file does?
bool is_zip(std::span<const std::uint8_t> bytes);

/// Every array by its name (without .npy), all values as F32. Members are stored or deflated; zip64, encryption and
/// other methods are refused. Fault::data that names the member and what is wrong: sizes are checked against the file
/// before memory is asked for, contents against their checksums.
TensorMap read_npz(const std::filesystem::path& path);

}  // namespace cloam
