// Arrays as numpy saves them (.npy, and the members of .npz): a short text says type and shape, raw values follow.
// numpy.lib.format, versions 1 to 3.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace cloam {

struct NpyArray {
  std::string name;                       // of the file, for errors
  std::string type;                       // as numpy writes it: "<f4"
  std::vector<std::uint64_t> shape;       // empty: one value
  bool columns_first = false;             // Fortran's order: the first index runs fastest
  std::span<const std::uint8_t> content;  // of exactly the size that type and shape give

  std::uint64_t length() const;  // the number of values
};

/// The bytes must outlive the array; what follows its last value is an error. Fault::data, with `name` at its head, for
/// what is no .npy, for objects (pickles), structures and texts, and for a shape that the bytes do not fill.
NpyArray parse_npy(std::span<const std::uint8_t> bytes, const std::string& name);

/// All values, the last index running fastest whatever the file's order. Booleans, whole numbers, and floats of 2, 4
/// and 8 bytes.
std::vector<float> npy_floats(const NpyArray& array);

}  // namespace cloam
