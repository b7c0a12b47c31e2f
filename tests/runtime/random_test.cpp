// Philox against its published vectors and a host version, and the distributions made of it.
#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

using Words = std::array<uint32_t, 4>;

/// Salmon et al. 2011, figure 2, with 64-bit products.
Words philox(Words c, uint32_t key0, uint32_t key1) {
  for (int round = 0; round < 10; round++) {
    const uint64_t a = uint64_t{0xD2511F53} * c[0], b = uint64_t{0xCD9E8D57} * c[2];
    c = {static_cast<uint32_t>(b >> 32) ^ c[1] ^ key0, static_cast<uint32_t>(b),
         static_cast<uint32_t>(a >> 32) ^ c[3] ^ key1, static_cast<uint32_t>(a)};
    key0 += 0x9E3779B9;
    key1 += 0xBB67AE85;
  }
  return c;
}

const RandomKey kKey{0x0123456789abcdef, 7, 9};

std::vector<uint32_t> expected_bits(int64_t n) {
  std::vector<uint32_t> out;
  for (uint32_t block = 0; static_cast<int64_t>(out.size()) < n; block++)
    for (uint32_t word : philox({block, 0, kKey.step, kKey.stream}, 0x89abcdef, 0x01234567))
      if (static_cast<int64_t>(out.size()) < n) out.push_back(word);
  return out;
}

}  // namespace

TEST_CASE("Philox gives the known answers of its authors") {
  using Bits = std::vector<uint32_t>;
  CHECK(random_bits({4}, {}).to_host<uint32_t>() == Bits{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8});
  CHECK(random_bits({4}, {~0ull, ~0u, ~0u}, ~0ull).to_host<uint32_t>() ==
        Bits{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd});
  const RandomKey pi{0x299f31d0a4093822, 0x13198a2e, 0x03707344};
  CHECK(random_bits({4}, pi, 0x85a308d3243f6a88).to_host<uint32_t>() ==
        Bits{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1});
}

TEST_CASE("random tensors are Philox words, at any size") {
  for (int64_t n : {0, 1, 3, 4, 5, 127, 4099, 100003}) {
    const std::vector<uint32_t> bits = expected_bits(n);
    std::vector<float> uniform;
    std::vector<int32_t> below;
    for (uint32_t word : bits) {
      uniform.push_back(static_cast<float>(word >> 8) * 0x1p-24F);
      below.push_back(static_cast<int32_t>(uint64_t{word} * 1000 >> 32));
    }
    CHECK(random_bits({n}, kKey).to_host<uint32_t>() == bits);
    CHECK(random_uniform({n}, kKey).to_host() == uniform);
    CHECK(random_below({n}, 1000, kKey).to_host<int32_t>() == below);
  }
}

TEST_CASE("random_normal is Box-Muller of word pairs and has the moments of a normal") {
  const int64_t n = 100003;
  const std::vector<uint32_t> bits = expected_bits(n + 1);
  const std::vector<float> z = random_normal({n}, kKey).to_host();
  double worst = 0, mean = 0, square = 0, fourth = 0;
  for (int64_t i = 0; i < n; i++) {
    const double first = bits[i / 2 * 2] >> 8, second = bits[i / 2 * 2 + 1] >> 8;
    const double radius = std::sqrt(-2 * std::log((first + 1) * 0x1p-24));
    const double angle = 2 * std::numbers::pi * second * 0x1p-24;
    worst = std::max(worst, std::abs(z[i] - radius * (i % 2 ? std::sin(angle) : std::cos(angle))));
    mean += z[i] / double{n};
    square += double{z[i]} * z[i] / n;
    fourth += std::pow(double{z[i]}, 4) / n;
  }
  CHECK(worst < 3e-6);
  CHECK(std::abs(mean) < 0.02);
  CHECK(std::abs(square - 1) < 0.02);
  CHECK(std::abs(fourth - 3) < 0.1);
}

TEST_CASE("seed, step and stream each give other numbers") {
  const auto first = random_bits({64}, kKey).to_host<uint32_t>();
  for (const RandomKey& other : {RandomKey{kKey.seed + 1, 7, 9}, RandomKey{kKey.seed ^ 1ull << 40, 7, 9},
                                 RandomKey{kKey.seed, 8, 9}, RandomKey{kKey.seed, 7, 10}})
    CHECK(random_bits({64}, other).to_host<uint32_t>() != first);
  CHECK_THROWS_AS(random_below({4}, 0, kKey), Error);
  CHECK_THROWS_AS(random_below({4}, (int64_t{1} << 31) + 1, kKey), Error);
}
