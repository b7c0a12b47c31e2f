// Archives of arrays as numpy.savez and savez_compressed write them: a zip file with a .npy for each array.
#pragma once
#include <filesystem>

#include "models/io/safetensors.h"
#include "models/io/zip.h"

namespace cloam {

/// Every array by its name (without .npy), all values as F32. Fault::data that names the member and what is wrong.
TensorMap npz_tensors(const Zip& zip);
TensorMap read_npz(const std::filesystem::path& path);

}  // namespace cloam
