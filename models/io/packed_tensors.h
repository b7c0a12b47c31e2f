// Checkpoints made small for handing on: half precision, and each array of equal bytes, or of zeros, but once.
#pragma once
#include "models/io/safetensors.h"

namespace cloam {

/// F32 tensors become F16. Tensors that are all zero, and those that equal another, are left out; metadata says so
/// ("packed.NAME"), so unpack() brings them back. Fault::data naming the tensor whose values no half can hold.
SafetensorsFile pack(SafetensorsFile file);

/// The file as it was, but for the rounding; one that was not packed is left alone. Fault::data for metadata that do
/// not fit, and for more than kMostZeros bytes that are not in the file.
SafetensorsFile unpack(SafetensorsFile file);
constexpr uint64_t kMostZeros = uint64_t{1} << 30;

}  // namespace cloam
