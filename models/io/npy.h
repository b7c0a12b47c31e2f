// Arrays as numpy saves them (.npy, and the members of .npz): a short text says type and shape, raw values follow.
// numpy.lib.format, versions 1 to 3.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

/// Calls use(Number()) with the number that numpy calls by this kind ("f4", "u1"; "b1", truth values, are bytes).
/// False, and no call, for other kinds.
template <class Use>
bool with_numpy_kind(std::string_view kind, Use use) {
  const auto is = [&](const char* name, auto number) { return kind == name && (use(number), true); };
  return is("b1", std::uint8_t{}) || is("i1", std::int8_t{}) || is("u1", std::uint8_t{}) || is("i2", std::int16_t{}) ||
         is("u2", std::uint16_t{}) || is("i4", std::int32_t{}) || is("u4", std::uint32_t{}) ||
         is("i8", std::int64_t{}) || is("u8", std::uint64_t{}) || is("f4", float{}) || is("f8", double{});
}

/// Of one value; 0 for kinds that with_numpy_kind does not know.
std::size_t numpy_bytes(std::string_view kind);

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
