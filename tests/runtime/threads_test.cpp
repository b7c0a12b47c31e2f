// Two threads that use the library at once make the bytes of one after the other.
#include <doctest/doctest.h>

#include <barrier>
#include <future>
#include <set>
#include <thread>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/flat.h"
#include "runtime/ops/adam.h"
#include "runtime/ops/scan.h"
#include "runtime/variant.h"

using namespace cloam;

namespace {

constexpr int kSteps = 12, kRepeats = 6;

/// A network of two layers learns a function of its inputs: products, a convolution, sorts and segment sums, random
/// numbers, buffers of ever other sizes, the optimiser in place. What it ends with, and what it was at each step.
std::vector<float> small_training(uint32_t seed) {
  const int64_t width = 24 + 8 * static_cast<int64_t>(seed % 3);
  Tensor w = parameter(random_normal({16, width}, {seed, 0, 1}).to_host(), {16, width});
  Tensor v = parameter(random_normal({width, 1}, {seed, 0, 2}).to_host(), {width, 1});
  Tensor moments[] = {zeros(w.shape()), zeros(w.shape()), zeros(v.shape()), zeros(v.shape())};
  eval({moments[0], moments[1], moments[2], moments[3]});
  std::vector<float> seen;
  for (uint32_t step = 1; step <= kSteps; step++) {
    const int64_t rows = 200 + 37 * static_cast<int64_t>((step * seed) % 5);
    const Tensor x = random_uniform({rows, 16}, {seed, step, 3});
    const Tensor error = matmul(silu(matmul(x, w)), v) - sum(sin(3.f * x), {{1}, true});
    const Tensor loss = mean(square(error));
    const Tensors gradients = grad(loss, {w, v});
    eval({loss, gradients[0], gradients[1]});
    adam_step(w, moments[0], moments[1], gradients[0], {.learning_rate = 1e-2f, .step = step});
    adam_step(v, moments[2], moments[3], gradients[1], {.learning_rate = 1e-2f, .step = step});
    const Tensor picture = reshape(slice(x, 0, 0, 64), {1, 1, 32, 32});
    const Tensor blurred = conv2d(picture, full({1, 1, 3, 3}, 1.f / 9), {.pad = 1});
    const Sorted sorted = sort(reshape(error, {rows}));
    seen.push_back(loss.item());
    seen.push_back(max(blurred).item());
    for (const float key : sorted.keys.to_host()) seen.push_back(key);
  }
  for (const Tensor& t : {w, v})
    read_on_host(t, [&](std::span<const float> all) { seen.insert(seen.end(), all.begin(), all.end()); });
  return seen;
}

/// Both begin together.
std::pair<std::vector<float>, std::vector<float>> at_once(uint32_t a, uint32_t b) {
  std::barrier start(2);
  const auto work = [&](uint32_t seed) {
    start.arrive_and_wait();
    return small_training(seed);
  };
  auto other = std::async(std::launch::async, work, b);
  std::vector<float> mine = work(a);
  return {std::move(mine), other.get()};
}

}  // namespace

TEST_CASE("two threads that compute at once make the bytes of one after the other") {
  const std::vector<float> a = small_training(1), b = small_training(2);
  CHECK(a != b);
  for (int i = 0; i < kRepeats; i++) {
    const auto [first, second] = at_once(1, 2);
    CHECK(first == a);
    CHECK(second == b);
  }
}

TEST_CASE("two threads may evaluate, derive and drop what depends on one pending graph") {
  for (uint32_t i = 0; i < 20; i++) {
    const Tensor x = parameter(std::vector<float>(512, 0.5f), {8, 64});
    const Tensor shared = square(matmul(x, random_uniform({64, 64}, {i, 0, 0})));
    const auto work = [shared, x](float scale) {
      Tensor chain = shared;
      for (int k = 0; k < 50; k++) chain = chain + scale;
      return grad(mean(square(chain)), {x})[0].to_host();
    };
    std::barrier start(2);
    auto other = std::async(std::launch::async, [&] {
      start.arrive_and_wait();
      return work(0.01f);
    });
    start.arrive_and_wait();
    const std::vector<float> mine = work(0.02f);
    CHECK(other.get() == work(0.01f));
    CHECK(mine == work(0.02f));
  }
}

TEST_CASE("what a thread records is what it ran itself") {
  const Tensor x = random_uniform({32, 32}, {1, 0, 0});
  eval({x});
  std::set<std::string> launched;
  record_kernels(&launched);
  std::thread([&] { eval({cumsum(x, 0)}); }).join();
  CHECK(launched.empty());
  eval({cumsum(x, 1)});
  record_kernels(nullptr);
  CHECK_FALSE(launched.empty());
}

TEST_CASE("a fault of one thread is its own") {
  auto other = std::async(std::launch::async, [] { return small_training(1); });
  for (int i = 0; i < 50; i++) CHECK_THROWS_AS(from_host(std::vector<float>(3), {int64_t{1} << 40}), Error);
  for (int i = 0; i < 5; i++)
    CHECK_THROWS_AS(eval({random_uniform({1 << 20, 1}, {1, 0, 0}) + zeros({1, 1 << 25})}), Error);
  CHECK(other.get() == small_training(1));
}
