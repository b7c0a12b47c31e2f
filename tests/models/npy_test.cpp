// Arrays of numpy: read as numpy means them, refused when they are anything else.
#include "models/io/npy.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>

#include "runtime/error.h"
#include "tests/models/errors.h"

using namespace cloam;

namespace {

using Bytes = std::vector<std::uint8_t>;

template <class Value>
Bytes raw(const std::vector<Value>& values) {
  Bytes bytes(values.size() * sizeof(Value));
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

// Version 1, padded as numpy does.
Bytes npy(std::string header, const Bytes& content) {
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  std::string all = "\x93NUMPY";
  for (const std::size_t byte : {std::size_t{1}, std::size_t{0}, header.size() % 256, header.size() / 256}) {
    all += static_cast<char>(byte);
  }
  all += header + std::string(content.begin(), content.end());
  return {all.begin(), all.end()};
}

std::string header(const std::string& type, const std::string& shape, bool fortran = false) {
  return "{'descr': '" + type + "', 'fortran_order': " + (fortran ? "True" : "False") + ", 'shape': (" + shape + "), }";
}

std::string error_of(const Bytes& bytes) {
  return cloam::error_of([&] { parse_npy(bytes, "points.npy"); });
}

}  // namespace

TEST_CASE("npy: types, shapes and both orders") {
  const std::vector<float> wanted = {1, 2, 3, 4, 5, 6};
  const auto floats = [](const Bytes& bytes) { return npy_floats(parse_npy(bytes, "a.npy")); };
  CHECK(floats(npy(header("<f4", "2, 3"), raw(wanted))) == wanted);
  CHECK(floats(npy(header("<f8", "6,"), raw<double>({1, 2, 3, 4, 5, 6}))) == wanted);
  CHECK(floats(npy(header("<i8", "6,"), raw<std::int64_t>({1, 2, 3, 4, 5, 6}))) == wanted);
  CHECK(floats(npy(header("|u1", "6,"), Bytes{1, 2, 3, 4, 5, 6})) == wanted);
  CHECK(floats(npy(header("<f4", ""), raw<float>({7}))) == std::vector<float>{7});
  CHECK(floats(npy(header("<f4", "0, 3"), {})).empty());
  // Half a value each: 1, -2, the largest, the smallest above zero, infinity.
  const auto halves = floats(npy(header("<f2", "5,"), raw<std::uint16_t>({0x3C00, 0xC000, 0x7BFF, 1, 0x7C00})));
  CHECK(halves == std::vector<float>{1, -2, 65504, std::ldexp(1.0F, -24), INFINITY});
  // Element (i, j, k) of shape (2, 3, 2) in Fortran's order lies at i + 2 j + 6 k.
  std::vector<float> places(12);
  for (std::size_t i = 0; i < places.size(); ++i) places[i] = float(i);
  const auto turned = floats(npy(header("<f4", "2, 3, 2", true), raw(places)));
  CHECK(turned == std::vector<float>{0, 6, 2, 8, 4, 10, 1, 7, 3, 9, 5, 11});
}

TEST_CASE("npy: hostile and foreign files are named, nothing is allocated for them") {
  const Bytes sound = npy(header("<f4", "2, 3"), raw<float>({1, 2, 3, 4, 5, 6}));
  for (std::size_t size = 0; size < sound.size(); ++size) {
    CHECK(holds(error_of(Bytes(sound.begin(), sound.begin() + std::ptrdiff_t(size))), "points.npy: "));
  }
  const Bytes six = raw<float>({1, 2, 3, 4, 5, 6});
  CHECK(holds(error_of(npy(header("<f4", "7,"), six)), "asks for 28 bytes of values, found 24"));
  CHECK(holds(error_of(npy(header("<f4", "5,"), six)), "asks for 20 bytes"));
  CHECK(holds(error_of(npy(header("<f4", "4294967296, 4294967296, 2"), six)), "more values"));
  CHECK(holds(error_of(npy(header("<f4", "9999999999999999999999"), six)), "an extent of at most"));
  CHECK(holds(error_of(npy(header("<f4", "-1, 3"), six)), "a whole number"));
  CHECK(holds(error_of(npy(header("|O", "3,"), six)), "type |O"));
  CHECK(holds(error_of(npy(header(">f4", "6,"), six)), "little-endian"));
  CHECK(holds(error_of(npy("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (6,)}", six)), "structure"));
  CHECK(holds(error_of(npy("{'descr': '<f4', 'shape': (6,)}", six)), "each once"));
  CHECK(holds(error_of(npy("{'shape': (6,), 'shape': (6,)}", six)), "each once"));
  CHECK(holds(error_of(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (6,), 'more': 1}", six)), "each once"));
  CHECK(holds(error_of(npy("__import__('os')", six)), "looked for {"));
}
