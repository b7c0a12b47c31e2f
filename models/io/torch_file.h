// Files of PyTorch (torch.save of a state_dict()), read without it: a zip file with a pickle and a member for each
// storage of numbers, or, before PyTorch 1.6, a sequence of pickles with the storages behind them.
#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "models/io/safetensors.h"
#include "models/io/zip.h"

namespace cloam {

/// Is there a pickle as torch.save names it?
bool is_torch(const Zip& zip);
/// Do the bytes begin as a file of PyTorch before 1.6?
bool is_old_torch(std::span<const std::uint8_t> bytes);

/// Every tensor of the state dict, row-major, by its name; what is no tensor is left out. No code of the file runs:
/// names stand in a closed list (models/io/pickle.h). Fault::data that names the tensor and what is wrong: places are
/// checked against the storages, and sizes against the file before memory is asked for.
TensorMap torch_tensors(const Zip& zip);
/// `name` (the file) stands at the head of errors.
TensorMap old_torch_tensors(std::span<const std::uint8_t> bytes, const std::string& name);

}  // namespace cloam
