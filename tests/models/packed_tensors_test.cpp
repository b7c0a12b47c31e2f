#include "models/io/packed_tensors.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/io/tensors.h"
#include "runtime/error.h"

using namespace cloam;

namespace {

std::vector<float> floats(const SafetensorsFile& file, const std::string& name, int64_t count) {
  return values_from<float>(file.tensors, name, {count});
}

SafetensorsFile sample() {
  SafetensorsFile file;
  file.tensors["a"] = named_floats({1.f, -0.333333f, 1e-3f, 6e4f}, {4});
  file.tensors["b"] = named_floats(std::vector<float>(6, 0.f), {6});
  file.tensors["same"] = file.tensors["a"];
  file.tensors["steps"] = named_integers({3, 1 << 20});
  file.metadata = {{"step", "7"}};
  return file;
}

}  // namespace

TEST_CASE("packed tensors: halves, zeros and equal ones come back; nothing else changes") {
  const SafetensorsFile file = sample(), packed = pack(file), back = unpack(packed);
  CHECK(packed.tensors.size() == 2);
  CHECK(packed.tensors.at("a").data.size() == 8);
  CHECK(back.metadata == file.metadata);
  REQUIRE(back.tensors.size() == 4);
  const std::vector<float> before = floats(file, "a", 4), after = floats(back, "a", 4);
  for (std::size_t i = 0; i < 4; ++i)
    CHECK(std::abs(after[i] - before[i]) <= std::abs(before[i]) / 2048);  // half of the last of 11 bits
  CHECK(back.tensors.at("same") == back.tensors.at("a"));
  CHECK(back.tensors.at("b") == file.tensors.at("b"));
  CHECK(back.tensors.at("steps") == file.tensors.at("steps"));
  CHECK(unpack(file) == file);
  CHECK(pack(unpack(packed)) == packed);
}

TEST_CASE("packed tensors: what half precision or the metadata cannot say is an error") {
  SafetensorsFile file = sample();
  file.tensors["a"] = named_floats({7e4f}, {1});
  CHECK_THROWS_WITH_AS(pack(file), doctest::Contains("the tensor a has values beyond 65504"), Error);
  for (const char* words : {"zeros F16 1152921504606846976", "zeros F16 1048576 1048576", "zeros F16 -1",
                            "zeros F16 3 x", "zeros F99 3", "as nothing", "as b", "ones F16 3", ""}) {
    CAPTURE(words);
    SafetensorsFile packed = pack(sample());
    packed.metadata["packed.b"] = words;
    CHECK_THROWS_WITH_AS(unpack(packed), doctest::Contains("packed tensors: b is"), Error);
  }
}
