// Weights of networks that others trained, from the file that the user names.
#pragma once
#include <filesystem>

#include "models/io/safetensors.h"

namespace cloam {

/// All tensors of one file: .npz (models/io/npz.h), .pth (models/io/torch_file.h) or safetensors, told by its content;
/// or of the only such file in a folder. Fault::data for anything else, naming what was found.
struct Weights {
  std::filesystem::path file;
  TensorMap tensors;
  std::string sha256 = {};  // of the file, by which published weights are known
  bool has(const std::string& name) const { return tensors.count(name) == 1; }
  /// The F32 values of `name`, row-major. Fault::data that says what was found instead when it is missing, has another
  /// shape or type, or values that are not finite.
  std::vector<float> take(const std::string& name, const std::vector<int64_t>& shape) const;
  /// The first names with their shapes, for errors.
  std::string content() const;
};
Weights read_weights(const std::filesystem::path& path);

}  // namespace cloam
