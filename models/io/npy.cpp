// See npy.h. The header is the text of a Python dict, "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }";
// it is read as JSON, so nothing is ever evaluated.
#include "models/io/npy.h"

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "models/io/bytes.h"
#include "models/io/json.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::string_view kNpyMagic = "\x93NUMPY";
constexpr std::uint64_t kLongestNpyHeader = 10000;  // numpy's own limit
constexpr std::size_t kMaxAxes = 32;                // numpy's own limit

// 0 for types that are not read.
std::size_t bytes_of(std::string_view type) {
  if (type.size() != 3) return 0;
  const std::size_t bytes = type.substr(1) == "f2" ? 2 : numpy_bytes(type.substr(1));
  return type[0] == (bytes == 1 ? '|' : '<') ? bytes : 0;
}

// Python's words and brackets as JSON's; what it allows beyond them is no header of numpy's.
std::string as_json(std::string_view header) {
  std::string json;
  for (const char c : header) {
    if (c == ' ' || c == '\n') continue;
    if ((c == ')' || c == '}') && json.ends_with(',')) json.pop_back();
    const std::size_t change = std::string_view("'()TF").find(c);
    json += change == std::string_view::npos ? c : "\"[]tf"[change];
  }
  return json;
}

void read_shape(const Json& shape, const std::string& looked_for, NpyArray& array) {
  constexpr std::uint64_t most = std::uint64_t{1} << 56;
  if (shape.size() > kMaxAxes) bad_data(looked_for, "at most ", kMaxAxes, " axes");
  for (const Json& extent : shape) {
    if (!extent.is_number() || extent < 0) bad_data(looked_for + "a whole number");
    if (!extent.is_number_unsigned() || extent > most) bad_data(looked_for, "an extent of at most ", most);
    array.shape.push_back(extent);
  }
}

void read_header(std::string_view header, NpyArray& array) {
  const std::string looked_for = array.name + ": the .npy header is damaged: looked for ",
                    keys = looked_for + "descr, fortran_order and shape, each once";
  if (!header.starts_with('{')) bad_data(looked_for, "{ at '", printable(header.substr(0, 30)), "'");
  const Json json = parse_json(as_json(header), keys);
  if (json.size() != 3 || !json.contains("fortran_order")) bad_data(keys);
  if (member(json, "descr", keys).is_array())
    bad_data(looked_for + "an array of plain numbers (found a structure with fields)");
  array.type = string(json, "descr", keys);
  array.columns_first = flag(json, "fortran_order", false, keys);
  read_shape(cloam::array(json, "shape", keys), looked_for, array);
}

// The number of values; the product of hostile extents may exceed 64 bits.
std::uint64_t checked_length(const NpyArray& array, std::uint64_t most) {
  std::uint64_t length = 1;
  for (const std::uint64_t extent : array.shape) {
    if (extent == 0) return 0;
    if (length > most / extent) bad_data(array.name, ": its shape has more values than its bytes");
    length *= extent;
  }
  return length;
}

template <class Stored>
std::vector<float> converted(const NpyArray& array) {
  std::vector<float> values(array.content.size() / sizeof(Stored));
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(number_at<Stored>(array.content.data() + i * sizeof(Stored)));
  }
  return values;
}

std::vector<float> as_stored(const NpyArray& array) {
  const std::string kind = array.type.substr(1);
  if (kind == "f2") return converted<Eigen::half>(array);
  std::vector<float> values;
  with_numpy_kind(kind, [&](auto number) { values = converted<decltype(number)>(array); });
  return values;
}

}  // namespace

std::size_t numpy_bytes(std::string_view kind) {
  std::size_t bytes = 0;
  with_numpy_kind(kind, [&](auto number) { bytes = sizeof number; });
  return bytes;
}

std::uint64_t NpyArray::length() const {
  std::uint64_t length = 1;
  for (const std::uint64_t extent : shape) length *= extent;
  return length;
}

NpyArray parse_npy(std::span<const std::uint8_t> bytes, const std::string& name) {
  ByteReader reader(bytes, name);
  const auto magic = reader.take(std::min(kNpyMagic.size(), reader.remaining()), "the first bytes");
  if (!std::equal(magic.begin(), magic.end(), kNpyMagic.begin(), kNpyMagic.end(),
                  [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); }))
    bad_data(name, ": is not an .npy file: it does not begin with \\x93NUMPY; save it with numpy.save");
  const auto version = reader.little<std::uint8_t>("the version");
  reader.skip(1, "the version");
  if (version < 1 || version > 3) bad_data(name, ": .npy version ", int(version), ", want versions 1 to 3");
  const std::uint64_t length = version == 1 ? reader.little<std::uint16_t>("the length of the header")
                                            : reader.little<std::uint32_t>("the length of the header");
  if (length > kLongestNpyHeader) bad_data(name, ": a header of ", length, " bytes, the most is ", kLongestNpyHeader);
  const auto header = reader.take(length, "the header");
  NpyArray array;
  array.name = name;
  read_header({reinterpret_cast<const char*>(header.data()), header.size()}, array);
  const std::size_t size = bytes_of(array.type);
  if (size == 0)
    bad_data(name, ": holds values of type ", printable(array.type),
             ", want numbers in little-endian order: save it with .astype('<f4')");
  const std::uint64_t count = checked_length(array, std::numeric_limits<std::uint64_t>::max() / size);
  if (count * size != reader.remaining())
    bad_data(name, ": its shape asks for ", count * size, " bytes of values, found ", reader.remaining(),
             "; the file is damaged or truncated");
  array.content = reader.take(count * size, "the values");
  return array;
}

std::vector<float> npy_floats(const NpyArray& array) {
  std::vector<float> stored = as_stored(array);
  if (!array.columns_first || array.shape.size() < 2) return stored;
  // The first index runs fastest: walk the places of the result and count up in the file's order.
  std::vector<float> values(stored.size());
  std::vector<std::uint64_t> index(array.shape.size()), strides(array.shape.size());
  std::uint64_t stride = 1;
  for (std::size_t axis = 0; axis < strides.size(); ++axis) {
    strides[axis] = stride;
    stride *= array.shape[axis];
  }
  std::uint64_t from = 0;
  for (float& value : values) {
    value = stored[from];
    for (std::size_t axis = index.size(); axis-- > 0;) {
      from += strides[axis];
      if (++index[axis] < array.shape[axis]) break;
      from -= strides[axis] * array.shape[axis];
      index[axis] = 0;
    }
  }
  return values;
}

}  // namespace cloam
