// Random graphs of pointwise ops, views, reductions and kernel ops with several outputs: what fusion cuts apart must
// compute what the graph says, and so must its gradient.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"
#include "tests/op_cases/inputs.h"

using namespace cloam;

namespace {

/// A value on both sides; `size` bounds its magnitude, so that random chains stay far from overflow.
struct Pair {
  Tensor device;
  HostArray host;
};

HostArray both(const HostArray& a, const HostArray& b, double (*f)(double, double)) {
  return elementwise([f](const double* x) { return f(x[0], x[1]); })({a, b});
}
HostArray each(const HostArray& a, double (*f)(double)) {
  return elementwise([f](const double* x) { return f(x[0]); })({a});
}

HostArray turned(const HostArray& a) {
  return from_index({a.dim(1), a.dim(0)}, [&](const Shape& i) { return a.at({i[1], i[0]}); });
}

HostArray summed(const HostArray& a, int axis) {
  Shape shape = a.shape;
  shape[axis] = 1;
  HostArray out(shape);
  each_index(a.shape, [&](Shape i) {
    const double value = a.at(i);
    i[axis] = 0;
    out.at(i) += value / static_cast<double>(a.shape[axis]);
  });
  return out;
}

HostArray every_second(const HostArray& a) {
  return from_index({(a.dim(0) + 1) / 2, a.dim(1)}, [&](const Shape& i) { return a.at({2 * i[0], i[1]}); });
}

constexpr int64_t kSide = 7;

/// Spread or cut back to [7,7], so that any two values meet.
Pair squared(const Pair& x) {
  Pair out = x;
  if (x.host.dim(0) < kSide && x.host.dim(0) > 1) {
    out.device = pad(x.device, 0, 0, kSide - x.host.dim(0));
    out.host =
        from_index({kSide, x.host.dim(1)}, [&](const Shape& i) { return i[0] < x.host.dim(0) ? x.host.at(i) : 0.0; });
  }
  if (out.host.dim(1) < kSide && out.host.dim(1) > 1) {
    const Pair t = squared({transpose(out.device), turned(out.host)});
    return {transpose(t.device), turned(t.host)};
  }
  return out;
}

Pair next(const std::vector<Pair>& have, Numbers& numbers) {
  const auto pick = [&] { return have[static_cast<size_t>(numbers.below(static_cast<int64_t>(have.size())))]; };
  const Pair a = squared(pick()), b = squared(pick());
  switch (numbers.below(12)) {
    case 0:
      return {a.device + b.device, both(a.host, b.host, [](double x, double y) { return x + y; })};
    case 1:
      return {a.device * tanh(b.device), both(a.host, b.host, [](double x, double y) { return x * std::tanh(y); })};
    case 2:
      return {a.device - b.device * 0.5f, both(a.host, b.host, [](double x, double y) { return x - y * 0.5; })};
    case 3:
      return {sigmoid(a.device), each(a.host, [](double x) { return 1 / (1 + std::exp(-x)); })};
    case 4:
      return {sin(a.device) + 0.25f, each(a.host, [](double x) { return std::sin(x) + 0.25; })};
    case 5:
      return {transpose(a.device), turned(a.host)};
    case 6:
      return {mean(a.device, {{0}, true}), summed(a.host, 0)};
    case 7:
      return {mean(a.device, {{1}, true}), summed(a.host, 1)};
    case 8:
      return {slice(a.device, 0, 0, a.host.dim(0), 2), every_second(a.host)};
    case 9:
      return {a.device / (square(b.device) + 1.f),
              both(a.host, b.host, [](double x, double y) { return x / (y * y + 1); })};
    case 10:
      return {reshape(a.device, {a.host.dim(0), a.host.dim(1)}) * 0.5f, each(a.host, [](double x) { return x * 0.5; })};
    default:
      return {exp(-square(a.device)), each(a.host, [](double x) { return std::exp(-x * x); })};
  }
}

struct Graph {
  Tensors in;
  std::vector<Pair> values;
};

/// The same graph for the same seed, whatever the inputs' values.
Graph grown(const std::string& seed, const HostArrays& inputs, int ops) {
  Numbers numbers(seed);
  Graph out;
  for (const HostArray& input : inputs) {
    out.in.push_back(on_device(input, normal(input.shape), Lie::dense));
    out.values.push_back({out.in.back(), input});
  }
  for (int i = 0; i < ops; i++) out.values.push_back(next(out.values, numbers));
  return out;
}

double total(const HostArray& x) {
  double out = 0;
  for (double value : x.values) out += value;
  return out;
}

/// Central differences of the sum of the graph's last value.
double slope(const std::string& seed, HostArrays inputs, int ops, size_t element) {
  constexpr double kStep = 1e-5;
  double& x = inputs[0].values[element];
  x += kStep;
  const double up = total(grown(seed, inputs, ops).values.back().host);
  x -= 2 * kStep;
  return (up - total(grown(seed, inputs, ops).values.back().host)) / (2 * kStep);
}

void check_graph(const std::string& seed, int ops) {
  const HostArrays inputs = {host_input(normal({kSide, kSide}), seed + "a"), host_input(normal({1, kSide}), seed + "b"),
                             host_input(normal({kSide, 1}), seed + "c")};
  const Graph graph = grown(seed, inputs, ops);
  const Tensor g = grad(sum(graph.values.back().device), {graph.in[0]})[0];
  Tensors outputs = {g};
  for (size_t i = 3; i < graph.values.size(); i += 4) outputs.push_back(graph.values[i].device);
  outputs.push_back(graph.values.back().device);
  eval(outputs);
  for (size_t i = 0; i < graph.values.size(); i++) {
    CAPTURE(i);
    if (!graph.values[i].device.evaluated()) continue;
    const HostArray found = host_output(graph.values[i].device);
    REQUIRE(found.shape == graph.values[i].host.shape);
    for (int64_t k = 0; k < found.size(); k++)
      CHECK(found[k] == doctest::Approx(graph.values[i].host[k]).epsilon(1e-4));
  }
  const HostArray found = host_output(g);
  for (size_t element : {size_t{0}, size_t{17}, size_t{48}})
    CHECK(found.values[element] == doctest::Approx(slope(seed, inputs, ops, element)).epsilon(1e-4));
}

}  // namespace

TEST_CASE("random graphs compute what they say") {
  for (int ops : {6, 12, 25, 25, 50, 50, 100}) {
    static int number = 0;
    const std::string seed = "graph " + std::to_string(number++);
    CAPTURE(seed);
    check_graph(seed, ops);
  }
}
