// Rows of the random tensors: their words are Philox4x32-10 (Salmon et al. 2011), so a host loop gives the same
// numbers.
#include <array>
#include <cmath>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

constexpr RandomKey kKey{0x0123456789abcdef, 7, 9};

using Words = std::array<uint32_t, 4>;

Words block(uint32_t number) {
  Words c = {number, 0, kKey.step, kKey.stream};
  auto low = static_cast<uint32_t>(kKey.seed), high = static_cast<uint32_t>(kKey.seed >> 32);
  for (int round = 0; round < 10; round++, low += 0x9E3779B9u, high += 0xBB67AE85u) {
    const uint64_t a = uint64_t{c[0]} * 0xD2511F53u, b = uint64_t{c[2]} * 0xCD9E8D57u;
    c = {static_cast<uint32_t>(b >> 32) ^ c[1] ^ low, static_cast<uint32_t>(b),
         static_cast<uint32_t>(a >> 32) ^ c[3] ^ high, static_cast<uint32_t>(a)};
  }
  return c;
}

double word(int64_t i) { return block(static_cast<uint32_t>(i / 4))[static_cast<size_t>(i % 4)]; }
double uniform(int64_t i) { return std::floor(word(i) / 256) / 16777216; }

double box_muller(int64_t i) {
  const int64_t pair = i / 2 * 2;
  const double radius = std::sqrt(-2 * std::log(uniform(pair) + 0x1p-24)), angle = 2 * M_PI * uniform(pair + 1);
  return radius * (i % 2 ? std::sin(angle) : std::cos(angle));
}

OpCase drawing(const char* op, DType result, Tensor (*run)(const Shape&), double (*truth)(int64_t)) {
  const Shape shape = {7, 13};
  return {
      .op = op,
      .run = [=](const Tensors&) { return run(shape); },
      .reference =
          [=](const HostArrays&) { return from_index(shape, [&](const Shape& i) { return truth(i[0] * 13 + i[1]); }); },
      .result = result,
      .tolerance = 0};
}

}  // namespace

void add_random_cases(OpCases& rows) {
  rows.push_back(drawing(
      "random_bits", DType::u32, [](const Shape& s) { return random_bits(s, kKey); }, word));
  rows.push_back(drawing(
      "random_uniform", DType::f32, [](const Shape& s) { return random_uniform(s, kKey); }, uniform));
  rows.push_back(drawing(
      "random_normal", DType::f32, [](const Shape& s) { return random_normal(s, kKey); }, box_muller));
  rows.back().tolerance = 1e-5;
  rows.push_back(drawing(
      "random_below", DType::i32, [](const Shape& s) { return random_below(s, 1000, kKey); },
      [](int64_t i) { return std::floor(word(i) * 1000 / 4294967296.0); }));
}

}  // namespace cloam
