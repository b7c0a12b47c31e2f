// Gathers, scatters, the sort and segment sums against plain loops and std::stable_sort.
#include <doctest/doctest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <random>

#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

using Floats = std::vector<float>;
using Ints = std::vector<int32_t>;

std::mt19937& random_source() {
  static std::mt19937 one(5);
  return one;
}

/// Multiples of 1/8: sums of up to a million of them are exact in float32, so results must be equal, not close.
Floats eighths(int64_t count) {
  Floats out(count);
  for (float& value : out) value = static_cast<float>(static_cast<int>(random_source()() % 33) - 16) / 8.0F;
  return out;
}

Ints integers(int64_t count, int64_t low, int64_t end) {
  Ints out(count);
  for (int32_t& value : out) value = static_cast<int32_t>(low + random_source()() % (end - low));
  return out;
}

Shape rows_by(const Shape& rows, const Shape& tail) {
  Shape out = rows;
  for (int64_t size : tail) out.push_back(size);
  return out;
}

struct Case {
  int64_t count;  // rows of the table
  Shape rows, tail;
};

const std::vector<Case> kCases = {{1, {1}, {}},           {5, {7}, {3}},          {5, {0}, {3}},
                                  {13, {4, 9}, {2, 3}},   {1000, {100000}, {}},   {3, {50000}, {4}},
                                  {70000, {3000}, {4}},   {70001, {100003}, {3}}, {100003, {1000}, {}},
                                  {300000, {10007}, {1}}, {200000, {90000}, {1}}};

/// out[row of i] += values[i], row numbers clamped to the table.
Floats scattered(const Floats& values, const Ints& rows, int64_t count, int64_t width) {
  Floats out(count * width);
  for (size_t i = 0; i < rows.size(); i++)
    for (int64_t c = 0; c < width; c++)
      out[std::clamp<int64_t>(rows[i], 0, count - 1) * width + c] += values[i * width + c];
  return out;
}

template <class T>
std::vector<T> gathered(const std::vector<T>& table, const Ints& rows, int64_t count, int64_t width) {
  std::vector<T> out;
  for (int32_t row : rows)
    for (int64_t c = 0; c < width; c++) out.push_back(table[std::clamp<int64_t>(row, 0, count - 1) * width + c]);
  return out;
}

void check_rows(const Case& one, const Ints& rows) {
  const int64_t width = numel(one.tail);
  const Shape table_shape = rows_by({one.count}, one.tail), value_shape = rows_by(one.rows, one.tail);
  const Floats table = eighths(numel(table_shape)), values = eighths(numel(value_shape));
  const Tensor from = parameter(table, table_shape), weights = parameter(values, value_shape);
  const Tensor numbers = from_host(rows, one.rows), out = gather_rows(from, numbers);
  CHECK(out.shape() == value_shape);
  CHECK(out.to_host() == gathered(table, rows, one.count, width));
  const Tensor g = grad(sum(out * weights), {from})[0];
  CHECK(g.to_host() == scattered(values, rows, one.count, width));
  const Floats other = eighths(numel(table_shape));
  const Tensor back = grad(sum(g * from_host(other, table_shape)), {weights})[0];
  CHECK(back.to_host() == gathered(other, rows, one.count, width));
}

/// Order by value; -0 before 0, NaN after all.
template <class T>
bool before(T a, T b) {
  if constexpr (std::is_same_v<T, float>) {
    if (std::isnan(a) || std::isnan(b)) return !std::isnan(a);
    if (a == b) return std::signbit(a) && !std::signbit(b);
  }
  return a < b;
}

template <class T>
void check_sort(const std::vector<T>& keys, int bits = 32) {
  const auto n = static_cast<int64_t>(keys.size());
  Ints order(n);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int32_t a, int32_t b) { return before(keys[a], keys[b]); });
  const Sorted sorted = sort(from_host(keys, {n}), bits);
  CHECK(sorted.order.to_host<int32_t>() == order);
  const std::vector<T> got = sorted.keys.template to_host<T>();
  bool equal = got.size() == keys.size();
  for (int64_t i = 0; equal && i < n; i++)
    equal = std::bit_cast<uint32_t>(got[i]) == std::bit_cast<uint32_t>(keys[order[i]]);
  CHECK(equal);
}

void check_segments(int64_t n, int64_t count, int64_t width) {
  CAPTURE(n);
  CAPTURE(count);
  CAPTURE(width);
  Ints ids = integers(n, -1, count + 1), offsets;
  std::sort(ids.begin(), ids.end());
  for (int64_t id = 0; id <= count; id++)
    offsets.push_back(static_cast<int32_t>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin()));
  const Tensor device_offsets = segment_offsets(from_host(ids, {n}), count);
  CHECK(device_offsets.to_host<int32_t>() == offsets);

  const Floats values = eighths(n * width), weights = eighths(count * width);
  Floats sums(count * width), spread(n * width);
  for (int64_t i = 0; i < n * width; i++) {
    const int64_t id = ids[i / width];
    if (id < 0 || id >= count) continue;
    sums[id * width + i % width] += values[i];
    spread[i] = weights[id * width + i % width];
  }
  const Tensor x = parameter(values, {n, width}), w = parameter(weights, {count, width});
  const Tensor out = segment_sum(x, device_offsets), g = grad(sum(out * w), {x})[0];
  CHECK(out.to_host() == sums);
  CHECK(g.to_host() == spread);
  CHECK(grad(sum(g * x), {w})[0].to_host() == sums);
}

/// Any bits, and often a NaN of either sign, a zero of either sign or an infinity.
Floats wild_floats(int64_t count) {
  const uint32_t special[] = {0x7fc00000, 0xffc00001, 0, 0x80000000, 0xff800000, 0x7f800000};
  Floats out(count);
  for (float& value : out) {
    const auto bits = static_cast<uint32_t>(random_source()());
    value = std::bit_cast<float>(bits % 3 == 0 ? special[bits / 3 % 6] : bits);
  }
  return out;
}

}  // namespace

TEST_CASE("gather_rows, its gradient and the gradient of that") {
  for (const Case& one : kCases) {
    CAPTURE(one.count);
    check_rows(one, integers(numel(one.rows), -2, one.count + 2));
  }
}

TEST_CASE("a row that most values share is summed right") {
  for (int64_t count : {7, 100000}) {
    Ints rows = integers(150000, 0, count);
    for (size_t i = 0; i < rows.size(); i++)
      if (i % 16) rows[i] = 3;
    check_rows({count, {150000}, {2}}, rows);
  }
}

TEST_CASE("gather_rows takes bytes and integers") {
  const Ints rows = integers(1001, 0, 50);
  std::vector<uint8_t> bytes;
  for (int32_t value : integers(150, 0, 256)) bytes.push_back(static_cast<uint8_t>(value));
  CHECK(gather_rows(from_host(bytes, {50, 3}), from_host(rows, {1001})).to_host<uint8_t>() ==
        gathered(bytes, rows, 50, 3));
  const Ints table = integers(50, -1000, 1000);
  CHECK(gather_rows(from_host(table, {50}), from_host(rows, {1001})).to_host<int32_t>() ==
        gathered(table, rows, 50, 1));
}

TEST_CASE("row ops refuse what they cannot do") {
  CHECK_THROWS_AS(gather_rows(ones({0, 3}), from_host(Ints{0}, {1})), Error);
  CHECK_THROWS_AS(gather_rows(ones({4}), ones({1})), Error);
  CHECK_THROWS_AS(scatter_add_rows(ones({4, 2}), from_host(Ints(3), {3}), 5), Error);
  CHECK_THROWS_AS(sort(ones({2, 2})), Error);
  CHECK_THROWS_AS(sort(ones({2}), 8), Error);
  CHECK_THROWS_AS(sort(from_host(Ints{1, 2, 3}, {3}), 0, from_host(Ints{1, 2}, {2})), Error);
  CHECK_THROWS_AS(segment_sum(ones({4}), ones({2})), Error);
}

TEST_CASE("sort is std::stable_sort") {
  for (int64_t n : {0, 1, 2, 97, 255, 256, 257, 4095, 4096, 4097, 65537, 1000003}) {
    CAPTURE(n);
    std::vector<uint32_t> keys(n);
    for (uint32_t& key : keys) key = static_cast<uint32_t>(random_source()());
    check_sort(keys);
    check_sort(integers(n, -1000000000, 1000000000));
    check_sort(integers(n, 0, 700), 10);
    check_sort(wild_floats(n));
  }
}

TEST_CASE("sort of 64-bit keys carries a payload") {
  for (int64_t n : {0, 1, 2, 255, 4097, 65537, 1000003}) {
    CAPTURE(n);
    std::vector<uint64_t> keys(n);
    for (uint64_t& key : keys) key = (static_cast<uint64_t>(random_source()() % 97) << 32) + random_source()();
    const Ints payload = integers(n, -1000, 1000);
    std::vector<size_t> order(n);
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return keys[a] < keys[b]; });
    const Sorted sorted = sort(from_bytes(keys.data(), DType::u32, {n, 2}), 0, from_host(payload, {n}));
    const std::vector<uint32_t> words = sorted.keys.to_host<uint32_t>();
    const Ints carried = sorted.order.to_host<int32_t>();
    bool equal = words.size() == 2 * keys.size() && carried.size() == keys.size();
    for (size_t i = 0; equal && i < order.size(); i++)
      equal = (uint64_t{words[2 * i + 1]} << 32 | words[2 * i]) == keys[order[i]] && carried[i] == payload[order[i]];
    CHECK(equal);
  }
}

TEST_CASE("a gradient reaches the keys of a sort") {
  const int64_t n = 5001;
  const Floats weights = eighths(n);
  const Tensor keys = parameter(eighths(n), {n});
  const Sorted sorted = sort(keys);
  const Floats g = grad(sum(sorted.keys * from_host(weights, {n})), {keys})[0].to_host();
  CHECK(gathered(g, sorted.order.to_host<int32_t>(), n, 1) == weights);
}

TEST_CASE("segments: offsets, sums, their gradient and the gradient of that") {
  using Sizes = std::pair<int64_t, int64_t>;
  for (const Sizes& sizes :
       {Sizes{0, 0}, {0, 5}, {1, 1}, {100, 7}, {4099, 300}, {5000, 9000}, {100000, 20011}, {300007, 2}})
    for (int64_t width : {1, 3, 32}) check_segments(sizes.first, sizes.second, width);
}
