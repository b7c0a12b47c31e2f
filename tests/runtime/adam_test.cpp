// The Adam step against the paper's recurrences in double.
#include "runtime/ops/adam.h"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

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

/// Kingma and Ba 2015, algorithm 1, with AdamW's decay; the betas are the floats that the device sees.
struct Reference {
  explicit Reference(const std::vector<float>& start) : p(start.begin(), start.end()), m(p.size()), v(p.size()) {}
  void step(int64_t i, double g, const AdamStep& with, int64_t t) {
    const double beta1 = with.beta1, beta2 = with.beta2, rate = with.learning_rate;
    m[i] = beta1 * m[i] + (1 - beta1) * g;
    v[i] = beta2 * v[i] + (1 - beta2) * g * g;
    const double mean = m[i] / (1 - std::pow(beta1, t)), square = v[i] / (1 - std::pow(beta2, t));
    p[i] -= rate * (mean / (std::sqrt(square) + with.epsilon) + with.weight_decay * p[i]);
  }
  double worst(const std::vector<float>& got) const {
    double most = 0;
    for (size_t i = 0; i < p.size(); i++) most = std::max(most, std::abs(p[i] - got[i]));
    return most;
  }
  std::vector<double> p, m, v;
};

}  // namespace

TEST_CASE("adam_step follows the paper over ten steps, for every handle, from a strided gradient") {
  for (int64_t n : {0, 1, 13, 4097, 100003}) {
    const std::vector<float> start = noise(n, 1);
    Tensor p = parameter(start, {n}), m = zeros({n}), v = zeros({n});
    const Tensor other_handle = p;
    Reference want(start);
    for (int t = 1; t <= 10; t++) {
      const std::vector<float> wide = noise(2 * n, static_cast<unsigned>(t));
      const AdamStep with{.learning_rate = 1e-2F, .weight_decay = t > 5 ? 0.1F : 0, .step = t};
      adam_step(p, m, v, slice(from_host(wide, {2 * n}), 0, 0, 2 * n, 2), with);
      for (int64_t i = 0; i < n; i++) want.step(i, wide[2 * i], with, t);
    }
    CHECK(want.worst(other_handle.to_host()) < 2e-6);
  }
}

TEST_CASE("adam_step_rows leaves rows without a gradient and counts the steps of each other") {
  for (const Shape& shape : {Shape{0, 3}, Shape{1, 1}, Shape{37, 5}, Shape{3001, 2, 4}}) {
    const int64_t rows = shape[0], width = rows ? numel(shape) / rows : 1;
    const std::vector<float> start = noise(numel(shape), 2);
    std::vector<int32_t> steps(rows);
    Tensor p = parameter(start, shape), m = zeros(shape), v = zeros(shape), counters = from_host(steps, {rows});
    Reference want(start);
    std::mt19937 random(3);
    for (unsigned t = 1; t <= 10; t++) {
      std::vector<float> g = noise(numel(shape), t);
      for (int64_t row = 0; row < rows; row++) {
        const bool used = random() % 2 == 0;
        for (int64_t i = row * width; i < (row + 1) * width; i++) g[i] = used ? g[i] + 3.0F : 0.0F;
        steps[row] += used;
        for (int64_t i = row * width; used && i < (row + 1) * width; i++) want.step(i, g[i], {}, steps[row]);
      }
      adam_step_rows(p, m, v, counters, from_host(g, shape), {});
    }
    CHECK(counters.to_host<int32_t>() == steps);
    CHECK(want.worst(p.to_host()) < 2e-6);
  }
}

TEST_CASE("steps of some rows at a time are the step of all, bit for bit") {
  const Shape shape{3001, 3};
  const std::vector<float> start = noise(9003, 4);
  struct State {
    Tensor p, m = zeros({3001, 3}), v = zeros({3001, 3}), steps = from_host(std::vector<int32_t>(3001, 0), {3001});
  };
  State whole{parameter(start, shape)}, parts = whole, dense{parameter(start, shape)}, dense_parts = dense;
  parts = {parameter(start, shape)};
  dense_parts = {parameter(start, shape)};
  for (int64_t t = 1; t <= 3; t++) {
    std::vector<float> g = noise(9003, static_cast<unsigned>(t));
    for (int64_t i = 0; i < 3000; i++) g[static_cast<size_t>(3 * i)] = 1;
    for (int i = 0; i < 3; i++) g[static_cast<size_t>(30 + i)] = 0;  // row 10 stands still where rows do
    const Tensor all = from_host(g, shape);
    AdamStep with{.learning_rate = 1e-2F, .step = t};
    adam_step(dense.p, dense.m, dense.v, all, with);
    adam_step_rows(whole.p, whole.m, whole.v, whole.steps, all, with);
    for (const auto& [begin, end] : {std::pair<int64_t, int64_t>{0, 1}, {1, 1999}, {1999, 1999}, {1999, 3001}}) {
      with.rows = {begin, end};
      adam_step(dense_parts.p, dense_parts.m, dense_parts.v, all, with);
      adam_step_rows(parts.p, parts.m, parts.v, parts.steps, all, with);
    }
  }
  for (const auto& [one, other] : {std::pair{&whole, &parts}, std::pair{&dense, &dense_parts}}) {
    CHECK(one->p.to_host() == other->p.to_host());
    CHECK(one->m.to_host() == other->m.to_host());
    CHECK(one->v.to_host() == other->v.to_host());
    CHECK(one->steps.to_host<int32_t>() == other->steps.to_host<int32_t>());
  }
  CHECK(whole.steps.to_host<int32_t>().at(10) == 0);
  CHECK(whole.steps.to_host<int32_t>().at(3000) == 3);
  AdamStep with;
  for (const AdamStep::Rows& rows : {AdamStep::Rows{3000, 3002}, {-1, 3}, {7, 5}}) {
    with.rows = rows;
    CHECK_THROWS_AS(adam_step(dense.p, dense.m, dense.v, ones(shape), with), Error);
    CHECK_THROWS_AS(adam_step_rows(whole.p, whole.m, whole.v, whole.steps, ones(shape), with), Error);
  }
}

TEST_CASE("the steps refuse state of another shape, and step 0") {
  Tensor p = parameter({1, 2}, {2}), m = zeros({2}), v = zeros({3}), w = zeros({2});
  CHECK_THROWS_AS(adam_step(p, m, v, ones({2}), {}), Error);
  CHECK_THROWS_AS(adam_step(p, m, w, ones({1}), {}), Error);
  CHECK_THROWS_AS(adam_step(p, m, w, ones({2}), {.step = 0}), Error);
  Tensor counters = zeros({2});
  CHECK_THROWS_AS(adam_step_rows(p, m, w, counters, ones({2}), {}), Error);
}
