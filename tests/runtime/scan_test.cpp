// Cumulative sums against a loop in double, their gradients, and the bits that thread counts must not change.
#include <doctest/doctest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

std::vector<float> noise(int64_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<float> out(count);
  for (float& value : out) value = static_cast<float>(random() % 2001) / 500.0F - 2.0F;
  return out;
}

/// Along `axis` of a row-major array, in double.
template <class T>
std::vector<double> running_sums(const std::vector<T>& x, const Shape& shape, int axis, const Cumulative& how) {
  int64_t inner = 1;
  for (int i = axis + 1; i < shape.rank(); i++) inner *= shape[i];
  const int64_t length = shape[axis], lines = x.empty() ? 0 : static_cast<int64_t>(x.size()) / length;
  std::vector<double> out(x.size());
  for (int64_t line = 0; line < lines; line++) {
    double total = 0;
    for (int64_t k = 0; k < length; k++) {
      const int64_t along = how.reverse ? length - 1 - k : k;
      const int64_t at = (line / inner * length + along) * inner + line % inner;
      out[at] = how.exclusive ? total : total + x[at];
      total += x[at];
    }
  }
  return out;
}

template <class T>
double worst(const std::vector<T>& got, const std::vector<double>& want) {
  double most = 0;
  REQUIRE(got.size() == want.size());
  for (size_t i = 0; i < got.size(); i++) most = std::max(most, std::abs(static_cast<double>(got[i]) - want[i]));
  return most;
}

void check_along(const Shape& shape, int axis, const Cumulative& how) {
  const std::vector<float> x = noise(numel(shape), 1), w = noise(numel(shape), 2);
  std::vector<int32_t> whole;
  for (float value : x) whole.push_back(static_cast<int32_t>(value * 500));
  const Tensor from = parameter(x, shape), sums = cumsum(from, axis, how);
  const Tensor g = grad(sum(sums * from_host(w, shape)), {from})[0];
  const double allowed = 1e-5 * (1 + static_cast<double>(shape[axis]));
  CHECK(worst(sums.to_host(), running_sums(x, shape, axis, how)) < allowed);
  CHECK(worst(g.to_host(), running_sums(w, shape, axis, {how.exclusive, !how.reverse})) < allowed);
  CHECK(worst(cumsum(from_host(whole, shape), axis, how).to_host<int32_t>(), running_sums(whole, shape, axis, how)) ==
        0);
}

/// FNV-1a over the bits of sums whose order could depend on threads.
uint64_t bits_of_sums() {
  const int64_t n = 100003;
  const Tensor values = random_normal({n, 3}, {1}), rows = random_below({n}, 1000, {2}),
               far = random_below({n}, 90000, {3});
  const Tensor offsets = segment_offsets(sort(rows).keys, 1000);
  uint64_t hash = 14695981039346656037ull;
  for (const Tensor& t : {cumsum(values, 0), scatter_add_rows(values, rows, 1000), scatter_add_rows(values, far, 90000),
                          segment_sum(values, offsets), sum(values)})
    for (float value : t.to_host()) {
      uint32_t word = 0;
      std::memcpy(&word, &value, 4);
      hash = (hash ^ word) * 1099511628211ull;
    }
  return hash;
}

/// Set, the process is a child that prints its bits.
const char* const kChild = "CLOAM_TEST_PRINT_BITS";

uint64_t bits_with_threads(int count) {
  char path[4096] = {};
  REQUIRE(readlink("/proc/self/exe", path, sizeof path - 1) > 0);
  char command[5000];
  std::snprintf(command, sizeof command, "%s=1 POCL_MAX_PTHREAD_COUNT=%d '%s' -tc='sums have the same bits*'", kChild,
                count, path);
  FILE* pipe = popen(command, "r");
  REQUIRE(pipe != nullptr);
  unsigned long long bits = 0;
  for (char line[256]; std::fgets(line, sizeof line, pipe);) std::sscanf(line, "bits %llx", &bits);
  pclose(pipe);
  return bits;
}

}  // namespace

TEST_CASE("cumsum follows the loop along every axis, both ways, and its gradient is the sum from the other end") {
  for (const Shape& shape :
       {Shape{0}, Shape{1}, Shape{7}, Shape{4095}, Shape{4096}, Shape{4097}, Shape{3, 5}, Shape{0, 4}, Shape{4, 0},
        Shape{300, 129}, Shape{5, 4099, 3}, Shape{2, 3, 65, 4}, Shape{1000003}})
    for (int axis = 0; axis < shape.rank(); axis++)
      for (const Cumulative& how : {Cumulative{false, false}, {false, true}, {true, false}, {true, true}})
        check_along(shape, axis, how);
}

TEST_CASE("cumsum is right where its result is larger than the caches") {
  const int64_t n = static_cast<int64_t>(device().cache_bytes) / 4 + 16 * 4099;
  const std::vector<int32_t> ones_summed = cumsum(from_host(std::vector<int32_t>(n, 1), {n}), 0).to_host<int32_t>();
  int64_t wrong = 0;
  for (int64_t i = 0; i < n; i++) wrong += ones_summed[i] != i + 1;
  CHECK(wrong == 0);
}

TEST_CASE("cumsum refuses bytes and axes that are not there") {
  CHECK_THROWS_AS(cumsum(from_host(std::vector<uint8_t>(4), {4}), 0), Error);
  CHECK_THROWS_AS(cumsum(ones({4}), 1), Error);
}

TEST_CASE("sums have the same bits with one thread and with two") {
  const uint64_t here = bits_of_sums();
  if (std::getenv(kChild)) {
    std::printf("bits %llx\n", static_cast<unsigned long long>(here));
    return;
  }
  CHECK(bits_with_threads(1) == here);
  CHECK(bits_with_threads(2) == here);
}
