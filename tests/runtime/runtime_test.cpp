// What the runtime promises beyond right values: few launches, plans and memory used again, clear ends, equal bits.
#include <doctest/doctest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <numeric>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/flat.h"
#include "runtime/ops.h"
#include "tests/runtime/child.h"

using namespace cloam;

namespace {

std::vector<float> ramp(int64_t count) {
  std::vector<float> out;
  for (int64_t i = 0; i < count; i++) out.push_back(static_cast<float>(i % 17) * 0.25f - 2.f);
  return out;
}

Tensor made(const Shape& shape) { return from_host(ramp(numel(shape)), shape); }

template <class Work>
int64_t launches(Work work) {
  const int64_t before = device_stats().launches;
  work();
  return device_stats().launches - before;
}

std::string message_of(const std::function<void()>& work, Fault fault) {
  try {
    work();
  } catch (const Error& error) {
    CHECK(error.fault() == fault);
    return error.what();
  }
  return "nothing was thrown";
}

bool contains(const std::string& whole, const std::string& part) { return whole.find(part) != std::string::npos; }

/// A loss with shared values, a broadcast, a reduction inside and gradients: the shape of a training step.
std::vector<float> step(int64_t rows, int64_t columns) {
  const Tensor x = made({rows, columns}), w = parameter(ramp(columns), {columns});
  const Tensor h = gelu(x * w) + 1.f;
  const Tensor loss = mean(square(h - mean(h, {{1}, true})));
  const Tensor g = grad(loss, {w})[0];
  eval({loss, g});
  return g.to_host();
}

}  // namespace

TEST_CASE("views launch nothing") {
  const Tensor x = made({6, 10});
  const Tensor view = slice(transpose(reshape(x, {3, 2, 10}), 0, 2), 0, 1, 9, 2);
  CHECK(launches([&] { eval({view}); }) == 0);
  CHECK(view.shape() == Shape{4, 2, 3});
  CHECK(view.to_host()[0] == ramp(60)[1]);
}

TEST_CASE("axes that are counted from the back are those from the front") {
  std::vector<float> values(24);
  std::iota(values.begin(), values.end(), 0.f);
  const Tensor x = from_host(values, {2, 3, 4});
  for (const Shape& axes : {Shape{-1, 0, 1}, Shape{2, -3, -2}, Shape{-1, -3, 1}}) {
    const Tensor turned = permute(x, axes);
    REQUIRE(turned.shape() == Shape{4, 2, 3});
    const std::vector<float> got = turned.to_host();
    for (size_t k = 0, at = 0; k < 4; k++)
      for (size_t i = 0; i < 2; i++)
        for (size_t j = 0; j < 3; j++, at++) CHECK(got[at] == values[(i * 3 + j) * 4 + k]);
  }
  const Tensor p = parameter(values, {2, 3, 4}), weights = from_host(values, {4, 2, 3});
  const std::vector<float> g = grad(sum(permute(p, {-1, 0, 1}) * weights), {p})[0].to_host();
  for (size_t k = 0, at = 0; k < 4; k++)
    for (size_t ij = 0; ij < 6; ij++, at++) CHECK(g[ij * 4 + k] == values[at]);
}

TEST_CASE("item is the value of any type") {
  CHECK(from_host(std::vector<int32_t>{-7}, {1}).item() == -7.f);
  CHECK(from_host(std::vector<uint32_t>{7}, {}).item() == 7.f);
  CHECK(from_host(std::vector<uint8_t>{200}, {1, 1}).item() == 200.f);
  CHECK(cast(Tensor(0.5f), DType::f16).item() == 0.5f);
}

TEST_CASE("a forked process is told that the device stays with the one that opened it") {
  const Tensor x = from_host(std::vector<float>{1, 2}, {2});
  eval({x * 2.f});
  const pid_t child = fork();
  if (child == 0) {
    alarm(20);  // what it is to be told comes at once
    try {
      (void)(x * 3.f).to_host();
    } catch (const Error& error) {
      _exit(error.fault() == Fault::device && std::string(error.what()).find("spawn") != std::string::npos ? 7 : 1);
    }
    _exit(2);
  }
  int status = 0;
  waitpid(child, &status, 0);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 7);
  CHECK((x * 3.f).to_host() == std::vector<float>{3, 6});
}

TEST_CASE("pointwise chains are one launch") {
  const Tensor x = made({5, 7}), y = made({7});
  CHECK(launches([&] { eval({gelu(x) + 1.f}); }) == 1);
  CHECK(launches([&] { eval({sigmoid(x * y) - transpose(made({7, 5}))}); }) == 1);
  CHECK(launches([&] { eval({x + y, x * y, tanh(x)}); }) == 1);  // siblings write side by side
}

TEST_CASE("a small reduction and what feeds it are one launch") {
  const Tensor x = made({5, 7});
  CHECK(launches([&] { eval({sum(square(x))}); }) == 1);
  CHECK(launches([&] { eval({max(x * 2.f - 1.f, {{0}})}); }) == 1);
}

TEST_CASE("plans and kernels serve other extents") {
  step(40, 50);
  step(41, 53);
  const DeviceStats before = device_stats();
  step(59, 61);
  step(40, 77);
  CHECK(device_stats().plans_built == before.plans_built);
  CHECK(device_stats().kernels_built == before.kernels_built);
  CHECK(device_stats().plans_reused > before.plans_reused);
}

TEST_CASE("the plans of many structures do not pile up: the last ones are kept") {
  const auto structure = [](int64_t nodes) {  // of one kernel
    Tensors out;
    for (int64_t i = 0; i < nodes; i++) out.push_back(ones({i + 3}) + 1.f);
    eval(out);
    return out.back().to_host();
  };
  const auto built = [&](int64_t nodes) {
    const uint64_t before = device_stats().plans_built;
    CHECK(structure(nodes) == std::vector<float>(static_cast<size_t>(nodes + 2), 2.f));
    return device_stats().plans_built - before;
  };
  for (int64_t nodes = 100; nodes < 250; nodes++) structure(nodes);
  CHECK(built(249) == 0);
  CHECK(built(150) == 0);
  CHECK(built(100) == 1);
  CHECK(built(100) == 0);
  CHECK(built(150) == 0);
}

// Compilers of GPUs contract across statements, PoCL's within one: this is for the former.
TEST_CASE("the difference of equal products is 0: pointwise kernels contract nothing") {
  const Tensor x = made({1000}), y = made({1000}) + 0.37f;
  const Tensor a = from_host(x.to_host(), {1000}), b = from_host(y.to_host(), {1000});
  CHECK((x * y - a * b).to_host() == std::vector<float>(1000, 0.0f));
}

TEST_CASE("scalars are no part of a plan") {
  const Tensor x = made({40});
  eval({x * 2.f});
  const DeviceStats before = device_stats();
  CHECK((x * 3.f).to_host()[1] == 3.f * ramp(2)[1]);
  CHECK(device_stats().plans_built == before.plans_built);
  CHECK(device_stats().kernels_built == before.kernels_built);
}

TEST_CASE("memory is used again while sizes change") {
  for (int64_t rows : {520, 500, 520}) step(rows, 100);
  const uint64_t before = device_stats().allocated_bytes;
  for (int64_t i = 0; i < 20; i++) step(500 + i, 100);
  CHECK(device_stats().allocated_bytes == before);
}

TEST_CASE("a thousand small ops: one launch when recorded whole, no new memory once warm") {
  const Tensor start = made({4096}), step = made({4096}) * 0.25f;
  eval({step});
  const auto chain = [&](bool one_by_one) {
    Tensor x = start;
    for (int i = 0; i < 1000; i++) {
      x = i % 2 == 0 ? x + step : x * step;
      if (one_by_one) eval({x});
    }
    return x.to_host();
  };
  std::vector<float> whole, single;
  CHECK(launches([&] { whole = chain(false); }) == 1);
  CHECK(launches([&] { single = chain(true); }) == 1000);
  CHECK(whole == single);
  const uint64_t before = device_stats().allocated_bytes;
  chain(false);
  chain(true);
  CHECK(device_stats().allocated_bytes == before);
}

TEST_CASE("memory that is kept free stays in proportion to what was in use at once, whatever sizes come") {
  trim_memory();
  const uint64_t largest = std::min(uint64_t{1} << 29, device().max_alloc_bytes);
  uint64_t all = 0;
  for (uint64_t bytes = largest / 32; bytes <= largest; bytes += bytes / 5) {  // one at a time, each of its own class
    eval({random_uniform({static_cast<int64_t>(bytes / 4)}, {1, 0, 0})});
    all += bytes;
    CHECK(device_stats().kept_bytes <= 3 * largest);  // what was in use at once, twice, each up to 25 % too large
  }
  CHECK(all > 4 * largest);  // without a bound, all of them would be kept
  CHECK(device_stats().kept_bytes > 0);
  trim_memory();
  CHECK(device_stats().kept_bytes == 0);
}

TEST_CASE("a pointwise result takes the buffer of a value that dies, and of no other") {
  const Tensor x = made({1 << 20});
  const auto scanned = [&] { return cumsum(x, 0); };
  const auto peak_of = [](const Tensors& outputs) {
    const uint64_t before = device_stats().peak_bytes = device_stats().live_bytes;
    eval(outputs);
    return device_stats().peak_bytes - before;
  };
  eval({scanned() * 2.f});
  const uint64_t alone = peak_of({scanned()});
  CHECK(peak_of({scanned() * 2.f + x}) == alone);
  const Tensor kept = scanned(), view = slice(scanned(), 0, 5, 9);
  CHECK(peak_of({kept, kept * 2.f}) > alone);
  const Tensor both = (reshape(kept, {1024, 1024}) * 0.5f) + transpose(reshape(kept, {1024, 1024}));
  CHECK(both.to_host()[1] == 0.5f * kept.to_host()[1] + kept.to_host()[1024]);
  const Tensor source = scanned(), half = source * 0.5f, part = slice(source, 0, 5, 9);
  CHECK((sum(half) + sum(part)).item() == doctest::Approx(sum(kept).item() * 0.5f + sum(slice(kept, 0, 5, 9)).item()));
}

TEST_CASE("results larger than the caches are right, in rows and at their ends") {
  const auto beyond = static_cast<int64_t>(std::min(device().cache_bytes / 4, device().max_alloc_bytes / 16));
  for (const Shape& shape : {Shape{beyond + 1237}, Shape{beyond / 80 + 3, 80}, Shape{beyond / 77 + 3, 77}}) {
    const Tensor x = made(shape), bias = made({shape.back()});
    const Tensors results = {relu(x + bias), x * bias};
    eval(results);
    const std::vector<float> a = results[0].to_host(), b = results[1].to_host();
    const std::vector<float> values = ramp(numel(shape)), biases = ramp(shape.back());
    int64_t wrong = 0;
    for (size_t i = 0; i < values.size(); i++) {
      const float with = biases[i % biases.size()];
      wrong += a[i] != std::max(values[i] + with, 0.f) || b[i] != values[i] * with;
    }
    CHECK(wrong == 0);
  }
}

TEST_CASE("what is made to stay takes the memory that it needs, and gives it back to the driver") {
  const Tensor x = made({33, 1025});
  x.to_host();
  const DeviceStats before = device_stats();
  {
    const Tensor kept = made_to_stay(x);
    CHECK(device_stats().live_bytes - before.live_bytes < size_t{33} * 1025 * size_of(DType::f32) + 256);
    CHECK(kept.to_host() == x.to_host());
    CHECK((kept + 1.f).to_host()[7] == x.to_host()[7] + 1.f);
  }
  CHECK(device_stats().live_bytes == before.live_bytes);
}

TEST_CASE("nothing stays alive when the last handle goes") {
  const uint64_t before = device_stats().live_bytes;
  {
    const Tensor x = made({100, 100});
    step(100, 100);
    sum(matmul(x, x)).item();
    CHECK(device_stats().live_bytes > before);
  }
  CHECK(device_stats().live_bytes == before);
}

TEST_CASE("a tensor over the budget is refused with the numbers") {
  const auto side = static_cast<int64_t>(std::sqrt(static_cast<double>(memory_budget()))) + 1000;
  const Tensor column = made({side, 1}), row = made({side});
  const std::string said = message_of([&] { eval({column + row}); }, Fault::memory);
  CHECK(contains(said, text("budget of ", memory_budget() >> 20, " MiB")));
  unsigned long long asked = 0;
  REQUIRE(std::sscanf(said.c_str(), "out of memory: %*[^0-9]%llu MiB", &asked) == 1);
  CHECK(asked >= static_cast<uint64_t>(side * side * 4) >> 20);
  CHECK((made({3}) + 1.f).to_host().size() == 3);  // and goes on
}

TEST_CASE("gradients can be differentiated again") {
  const Tensor x = parameter({-2.f, 0.5f, 3.f}, {3});
  const Tensor first = grad(sum(x * x * x), {x})[0];
  const Tensor second = grad(sum(first), {x})[0];
  const Tensor third = grad(sum(second), {x})[0];
  CHECK(first.to_host() == std::vector<float>{12.f, 0.75f, 27.f});
  CHECK(second.to_host() == std::vector<float>{-12.f, 3.f, 18.f});
  CHECK(third.to_host() == std::vector<float>{6.f, 6.f, 6.f});
}

TEST_CASE("gradients reach only what the loss reads") {
  const Tensor x = parameter({1.f, 2.f}, {2}), unused = parameter({1.f}, {1});
  const Tensors g = grad(sum(x * stop_gradient(x)), {x, unused});
  CHECK(g[0].to_host() == std::vector<float>{1.f, 2.f});
  CHECK(g[1].to_host() == std::vector<float>{0.f});
}

TEST_CASE("keys that no query attends to have gradients of zero") {
  const Tensor q = parameter({}, {2, 0, 4}), k = parameter(std::vector<float>(56, 1.f), {2, 7, 4});
  CHECK(grad(sum(attention(q, k, k)), {k})[0].to_host() == std::vector<float>(56, 0.f));
}

TEST_CASE("assign changes every handle and checks shapes") {
  const Tensor x = parameter({1.f, 2.f}, {2}), y = parameter({5.f, 6.f}, {2}), other = x;
  assign({{x, y * 2.f}, {y, x * 10.f}});  // both values are those from before
  CHECK(other.to_host() == std::vector<float>{10.f, 12.f});
  CHECK(y.to_host() == std::vector<float>{10.f, 20.f});
  CHECK(contains(message_of([&] { assign({{x, made({3})}}); }, Fault::internal), "[2]"));
}

TEST_CASE("a chain of 50,000 ops is evaluated, differentiated and freed") {
  const Tensor x = parameter({1.f, 2.f}, {2});
  {
    Tensor y = x;
    for (int i = 0; i < 50000; i++) y = y + x;
    CHECK(y.to_host() == std::vector<float>{50001.f, 100002.f});
  }
  Tensor y = x;
  for (int i = 0; i < 50000; i++) y = -y;
  CHECK(grad(sum(y), {x})[0].to_host() == std::vector<float>{1.f, 1.f});
  Tensor never = x;
  for (int i = 0; i < 50000; i++) never = never * x;  // freed without being evaluated
}

TEST_CASE("child: bits of sums" * doctest::skip()) {
  const Tensor x = made({307, 211}), w = made({211, 67});
  const Tensor image = made({2, 5, 33, 37}), filter = made({7, 5, 3, 3});
  uint64_t hash = 14695981039346656037ull;
  for (const Tensor& t : {sum(x * 0.1f), sum(exp(x), {{0}}), sum(exp(x), {{1}}), matmul(x * 0.1f, w),
                          conv2d(image * 0.1f, filter), softmax(matmul(x, w), 1), sum(made({101, 1003}) * 0.1f)})
    for (float value : t.to_host()) {
      uint32_t word = 0;
      std::memcpy(&word, &value, 4);
      hash = (hash ^ word) * 1099511628211ull;
    }
  std::printf("bits %llx\n", static_cast<unsigned long long>(hash));
}

TEST_CASE("sums and products have the same bits with one thread and with two") {
  const auto bits = [](const char* environment) {
    const std::string out = output_of_child(environment, "child: bits of sums");
    const size_t at = out.find("bits ");
    return at == std::string::npos ? out : out.substr(at, out.find('\n', at) - at);
  };
  const std::string one = bits("POCL_MAX_PTHREAD_COUNT=1");
  CHECK(one.substr(0, 5) == "bits ");
  CHECK(bits("POCL_MAX_PTHREAD_COUNT=2") == one);
}

TEST_CASE("child: a logarithm below zero" * doctest::skip()) {
  const Tensor x = made({2, 3}) + 2.5f;
  std::printf("%s\n", message_of([&] { eval({sum(matmul(log(x - 100.f), made({3, 2})))}); }, Fault::diverged).c_str());
}

TEST_CASE("CLOAM_DEBUG=nan names the op that made the first one") {
  const std::string out = output_of_child("CLOAM_DEBUG=nan", "child: a logarithm below zero");
  CHECK_MESSAGE(contains(out, "first non-finite value: "), out);
  CHECK_MESSAGE(contains(out, " of [2,3], made by [add subtract log]"), out);
}

TEST_CASE("child: any device" * doctest::skip()) {
  try {
    std::printf("device %s\n", device().name.c_str());
  } catch (const Error& error) { std::printf("fault %d: %s\n", static_cast<int>(error.fault()), error.what()); }
}

TEST_CASE("a device that is not there is named, with what is") {
  const std::string out = output_of_child("CLOAM_DEVICE='no such thing'", "child: any device");
  CHECK_MESSAGE(contains(out, "fault 4: no OpenCL device matches --device \"no such thing\""), out);
  CHECK_MESSAGE(contains(out, device().name), out);
  const std::string none = output_of_child("OCL_ICD_VENDORS=/nonexistent", "child: any device");
  CHECK_MESSAGE(contains(none, "fault 4: no OpenCL device found"), none);
  CHECK_MESSAGE(contains(none, "fix: "), none);
}

TEST_CASE("CLOAM_DEBUG=poison,bounds changes no result") {
  const std::string plain = output_of_child("", "child: bits of sums");
  const std::string guarded = output_of_child("CLOAM_DEBUG=poison,bounds", "child: bits of sums");
  REQUIRE(contains(plain, "bits "));
  CHECK(guarded.substr(guarded.find("bits "), 12) == plain.substr(plain.find("bits "), 12));
}
