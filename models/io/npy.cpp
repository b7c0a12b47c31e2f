// See npy.h. The header is the text of a Python dict, "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }";
// only that form is read, so nothing is ever evaluated.
#include "models/io/npy.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <string_view>

#include "models/io/bytes.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::uint64_t kLongestHeader = 10000;  // numpy's own limit
constexpr std::size_t kMostAxes = 32;            // numpy's own limit

// 0 for types that are not read.
std::size_t bytes_of(std::string_view type) {
  if (type.size() != 3) return 0;
  const std::string_view kind = type.substr(1);
  if (type[0] == '|') return kind == "b1" || kind == "i1" || kind == "u1" ? 1 : 0;
  if (type[0] != '<') return 0;
  if (kind == "i2" || kind == "u2" || kind == "f2") return 2;
  if (kind == "i4" || kind == "u4" || kind == "f4") return 4;
  return kind == "i8" || kind == "u8" || kind == "f8" ? 8 : 0;
}

class HeaderParser {
 public:
  HeaderParser(std::string_view header, NpyArray& array) : rest_(header), array_(array) {}

  void parse() {
    expect("{");
    while (!take("}")) {
      const std::string key = quoted();
      expect(":");
      read_value(key);
      if (take(",")) continue;
      expect("}");
      break;
    }
    skip_spaces();
    if (!rest_.empty() || !has_type_ || !has_order_ || !has_shape_) fail("descr, fortran_order and shape, each once");
  }

 private:
  [[noreturn]] void fail(const std::string& wanted) const {
    throw Error(Fault::data, text(array_.name, ": the .npy header is damaged: looked for ", wanted, " at '",
                                  printable(rest_.substr(0, 30)), "'"));
  }

  void skip_spaces() { rest_.remove_prefix(std::min(rest_.find_first_not_of(" \n"), rest_.size())); }

  bool take(std::string_view word) {
    skip_spaces();
    if (!rest_.starts_with(word)) return false;
    rest_.remove_prefix(word.size());
    return true;
  }

  void expect(std::string_view word) {
    if (!take(word)) fail(std::string(word));
  }

  std::string quoted() {
    skip_spaces();
    const char quote = rest_.empty() ? ' ' : rest_.front();
    const std::size_t end = quote == '\'' || quote == '"' ? rest_.find(quote, 1) : std::string_view::npos;
    if (end == std::string_view::npos) fail("a quoted word");
    const std::string word(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return word;
  }

  void read_value(const std::string& key) {
    bool& has = key == "descr" ? has_type_ : key == "fortran_order" ? has_order_ : has_shape_;
    if (has || (&has == &has_shape_ && key != "shape")) fail("descr, fortran_order and shape, each once");
    has = true;
    if (key == "descr") {
      skip_spaces();
      if (rest_.starts_with("[")) fail("an array of plain numbers (found a structure with fields)");
      array_.type = quoted();
    } else if (key == "shape") {
      read_shape();
    } else {
      array_.columns_first = take("True");
      if (!array_.columns_first) expect("False");
    }
  }

  void read_shape() {
    expect("(");
    while (!take(")")) {
      array_.shape.push_back(whole());
      if (array_.shape.size() > kMostAxes) fail(text("at most ", kMostAxes, " axes"));
      if (take(",")) continue;
      expect(")");
      break;
    }
  }

  std::uint64_t whole() {
    skip_spaces();
    constexpr std::uint64_t most = std::uint64_t{1} << 56;
    std::uint64_t value = 0;
    std::size_t digits = 0;
    for (; digits < rest_.size() && rest_[digits] >= '0' && rest_[digits] <= '9'; ++digits) {
      value = 10 * value + std::uint64_t(rest_[digits] - '0');
      if (value > most) fail(text("an extent of at most ", most));
    }
    if (digits == 0) fail("a whole number");
    rest_.remove_prefix(digits);
    return value;
  }

  std::string_view rest_;
  NpyArray& array_;
  bool has_type_ = false, has_order_ = false, has_shape_ = false;
};

// The number of values; the product of hostile extents may exceed 64 bits.
std::uint64_t checked_length(const NpyArray& array, std::uint64_t most) {
  std::uint64_t length = 1;
  for (const std::uint64_t extent : array.shape) {
    if (extent == 0) return 0;
    if (length > most / extent)
      throw Error(Fault::data, text(array.name, ": its shape has more values than its bytes"));
    length *= extent;
  }
  return length;
}

// IEEE 754 binary16, subnormal numbers included.
float from_half(std::uint16_t bits) {
  const std::uint32_t sign = std::uint32_t(bits & 0x8000) << 16, exponent = bits >> 10 & 31, fraction = bits & 1023;
  if (exponent == 0) {
    const float value = float(fraction) * 0x1p-24F;
    return sign ? -value : value;
  }
  const std::uint32_t wide = exponent == 31 ? 255 : exponent + 112, all = sign | wide << 23 | fraction << 13;
  float value;
  std::memcpy(&value, &all, sizeof value);
  return value;
}

template <class Stored>
std::vector<float> converted(const NpyArray& array) {
  std::vector<float> values(array.content.size() / sizeof(Stored));
  for (std::size_t i = 0; i < values.size(); ++i) {
    Stored value;
    std::memcpy(&value, array.content.data() + i * sizeof(Stored), sizeof(Stored));
    values[i] = static_cast<float>(value);
  }
  return values;
}

std::vector<float> as_stored(const NpyArray& array) {
  const std::string kind = array.type.substr(1);
  if (kind == "f4") return converted<float>(array);
  if (kind == "f8") return converted<double>(array);
  if (kind == "i1") return converted<std::int8_t>(array);
  if (kind == "i2") return converted<std::int16_t>(array);
  if (kind == "u2") return converted<std::uint16_t>(array);
  if (kind == "i4") return converted<std::int32_t>(array);
  if (kind == "u4") return converted<std::uint32_t>(array);
  if (kind == "i8") return converted<std::int64_t>(array);
  if (kind == "u8") return converted<std::uint64_t>(array);
  if (kind != "f2") return converted<std::uint8_t>(array);  // also booleans
  std::vector<float> values(array.length());
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = from_half(std::uint16_t(array.content[2 * i] | array.content[2 * i + 1] << 8));
  }
  return values;
}

}  // namespace

std::uint64_t NpyArray::length() const {
  std::uint64_t length = 1;
  for (const std::uint64_t extent : shape) length *= extent;
  return length;
}

NpyArray parse_npy(std::span<const std::uint8_t> bytes, const std::string& name) {
  ByteReader reader(bytes, name);
  const auto magic = reader.take(std::min(kMagic.size(), reader.remaining()), "the first bytes");
  if (!std::equal(magic.begin(), magic.end(), kMagic.begin(), kMagic.end(),
                  [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); })) {
    throw Error(Fault::data,
                text(name, ": is not an .npy file: it does not begin with \\x93NUMPY; save it with numpy.save"));
  }
  const auto version = reader.little<std::uint8_t>("the version");
  reader.skip(1, "the version");
  if (version < 1 || version > 3) {
    throw Error(Fault::data, text(name, ": .npy version ", int(version), ", want versions 1 to 3"));
  }
  const std::uint64_t length = version == 1 ? reader.little<std::uint16_t>("the length of the header")
                                            : reader.little<std::uint32_t>("the length of the header");
  if (length > kLongestHeader) {
    throw Error(Fault::data, text(name, ": a header of ", length, " bytes, the most is ", kLongestHeader));
  }
  const auto header = reader.take(length, "the header");
  NpyArray array;
  array.name = name;
  HeaderParser({reinterpret_cast<const char*>(header.data()), header.size()}, array).parse();
  const std::size_t size = bytes_of(array.type);
  if (size == 0) {
    throw Error(Fault::data, text(name, ": holds values of type ", printable(array.type),
                                  ", want numbers in little-endian order: save it with .astype('<f4')"));
  }
  const std::uint64_t count = checked_length(array, std::numeric_limits<std::uint64_t>::max() / size);
  if (count * size != reader.remaining()) {
    throw Error(Fault::data, text(name, ": its shape asks for ", count * size, " bytes of values, found ",
                                  reader.remaining(), "; the file is damaged or truncated"));
  }
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
