// Rows of the pointwise ops on floats.
#include <cmath>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

using UnaryOp = Tensor (*)(const Tensor&);
using BinaryOp = Tensor (*)(const Tensor&, const Tensor&);
using UnaryTruth = double (*)(double);
using BinaryTruth = double (*)(double, double);

OpCase unary(const char* op, UnaryOp run, UnaryTruth truth, const InputSpec& input) {
  return {.op = op,
          .inputs = {input},
          .run = [run](const Tensors& in) { return run(in[0]); },
          .reference = elementwise([truth](const double* x) { return truth(x[0]); }),
          .strided_gradient = false,
          .bench = {{.shape = {1 << 22}, .kind = input.kind, .low = input.low, .high = input.high}}};
}

/// The ends of an op's range, where formulas that are right in the middle overflow or cancel.
OpCase ends(const char* op, UnaryOp run, UnaryTruth truth, const std::vector<double>& at) {
  OpCase row = unary(op, run, truth, given({static_cast<int64_t>(at.size())}, at));
  row.label = "ends of the range";
  row.relative = true;
  row.bench = {};
  return row;
}

/// Most of the inputs lie where exp(-|x|) is less than the least normal float: CPUs are slow with such numbers, and no
/// result depends on them.
OpCase far(const char* op, UnaryOp run, UnaryTruth truth, double reach) {
  OpCase row = unary(op, run, truth, between({5, 7}, -reach, reach));
  row.label = "far from zero";
  row.gradient = false;  // next to nothing, the rounding of 1 - y * y
  return row;
}

OpCase binary(const char* op, BinaryOp run, BinaryTruth truth, const InputSpec& a, const InputSpec& b) {
  return {.op = op,
          .inputs = {a, b},
          .run = [run](const Tensors& in) { return run(in[0], in[1]); },
          .reference = elementwise([truth](const double* x) { return truth(x[0], x[1]); }),
          .strided_gradient = false};
}

/// Every operand is the smaller one on some axis.
OpCase broadcast_row(OpCase row) {
  row.label = "broadcast";
  row.inputs[0].shape = {3, 1, 7};
  row.inputs[1].shape = {5, 1};
  row.second_order = false;
  row.strided_gradient = true;
  return row;
}

void add_both(OpCases& rows, OpCase row) {
  rows.push_back(row);
  rows.push_back(broadcast_row(row));
}

double sigmoid_of(double x) { return 1 / (1 + std::exp(-x)); }
double softplus_of(double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); }
double gelu_of(double x) { return x * 0.5 * (1 + std::erf(x / std::sqrt(2.0))); }

OpCase second(OpCase row) {
  row.second_order = true;
  row.gradient_tolerance = 3e-4;
  return row;
}

void add_unary(OpCases& rows) {
  const InputSpec any = normal({5, 7}), positive = between({5, 7}, 0.3, 3.0);
  rows.push_back(unary(
      "negate", [](const Tensor& x) { return -x; }, [](double x) { return -x; }, any));
  rows.push_back(unary(
      "abs", abs, [](double x) { return std::abs(x); }, any));
  rows.push_back(unary(
      "sign", sign, [](double x) { return double((x > 0) - (x < 0)); }, constant(any)));
  rows.push_back(unary(
      "floor", floor, [](double x) { return std::floor(x); }, constant(between({5, 7}, -4, 4))));
  rows.push_back(second(unary(
      "square", square, [](double x) { return x * x; }, any)));
  rows.push_back(second(unary(
      "sqrt", sqrt, [](double x) { return std::sqrt(x); }, positive)));
  rows.push_back(second(unary(
      "rsqrt", rsqrt, [](double x) { return 1 / std::sqrt(x); }, positive)));
  rows.push_back(second(unary(
      "exp", exp, [](double x) { return std::exp(x); }, any)));
  rows.push_back(second(unary(
      "log", log, [](double x) { return std::log(x); }, positive)));
  rows.push_back(second(unary(
      "sin", sin, [](double x) { return std::sin(x); }, between({5, 7}, -9, 9))));
  rows.push_back(second(unary(
      "cos", cos, [](double x) { return std::cos(x); }, between({5, 7}, -9, 9))));
  rows.push_back(second(unary(
      "tanh", tanh, [](double x) { return std::tanh(x); }, any)));
  rows.push_back(second(unary(
      "erf", erf, [](double x) { return std::erf(x); }, any)));
  rows.push_back(second(unary("sigmoid", sigmoid, sigmoid_of, any)));
  rows.push_back(second(unary("softplus", softplus, softplus_of, any)));
  rows.push_back(second(unary(
      "silu", silu, [](double x) { return x * sigmoid_of(x); }, any)));
  rows.push_back(second(unary("gelu", gelu, gelu_of, any)));
  rows.push_back(unary(
      "relu", relu, [](double x) { return std::max(x, 0.0); }, any));
  rows.push_back(unary(
      "relu", relu, [](double x) { return std::max(x, 0.0); }, halves({5, 7})));
  rows.back().label = "halves";
  rows.back().result = DType::f16;
  rows.back().bench = {};
  rows.push_back(unary(
      "leaky_relu", [](const Tensor& x) { return leaky_relu(x, 0.2f); }, [](double x) { return x > 0 ? x : 0.2f * x; },
      any));
}

void add_ends(OpCases& rows) {
  rows.push_back(ends("exp", exp, [](double x) { return std::exp(x); }, {-80, -20, -1e-4, 0, 1e-4, 20, 80}));
  rows.push_back(ends("log", log, [](double x) { return std::log(x); }, {1e-30, 1e-6, 0.7, 0.999, 1.001, 1e6, 1e30}));
  rows.back().gradient = false;  // steps of central differences would leave the range
  rows.push_back(
      ends("tanh", tanh, [](double x) { return std::tanh(x); }, {-30, -0.7, -0.6, -1e-4, 1e-4, 0.625, 2, 30}));
  rows.push_back(ends("sigmoid", sigmoid, sigmoid_of, {-80, -30, -1, 0, 1, 30, 80}));
  rows.push_back(ends("softplus", softplus, softplus_of, {-80, -16, -1, 0, 1, 16, 80}));
  rows.push_back(
      ends("erf", erf, [](double x) { return std::erf(x); }, {-6, -1.1, -0.9, -1e-4, 1e-4, 0.99, 1.01, 3, 6}));
  // Beyond a few thousand a float's own spacing is what limits sin.
  rows.push_back(ends("sin", sin, [](double x) { return std::sin(x); }, {-1000, -100, -1e-4, 1e-4, 0.7, 100, 1000}));
  rows.push_back(ends("cos", cos, [](double x) { return std::cos(x); }, {-1000, -100, -1e-4, 1e-4, 0.7, 100, 1000}));
}

void add_far(OpCases& rows) {
  rows.push_back(unary(
      "exp", exp, [](double x) { return std::exp(x); }, between({5, 7}, -400, 0)));
  rows.back().label = "far from zero";
  rows.back().gradient = false;  // next to nothing: relative errors mean nothing
  rows.push_back(far(
      "tanh", tanh, [](double x) { return std::tanh(x); }, 200));
  rows.push_back(far(
      "erf", erf, [](double x) { return std::erf(x); }, 40));
  rows.push_back(far("sigmoid", sigmoid, sigmoid_of, 400));
  rows.push_back(far("softplus", softplus, softplus_of, 400));
  rows.push_back(far(
      "silu", silu, [](double x) { return x * sigmoid_of(x); }, 400));
}

void add_binary(OpCases& rows) {
  const InputSpec a = normal({5, 7}), b = normal({5, 7}), positive = between({5, 7}, 0.3, 3.0);
  add_both(rows, binary(
                     "add", operator+, [](double x, double y) { return x + y; }, a, b));
  add_both(rows, binary(
                     "subtract", operator-, [](double x, double y) { return x - y; }, a, b));
  add_both(rows, second(binary(
                     "multiply", operator*, [](double x, double y) { return x * y; }, a, b)));
  add_both(rows, second(binary(
                     "divide", operator/, [](double x, double y) { return x / y; }, a, positive)));
  add_both(rows, binary(
                     "minimum", minimum, [](double x, double y) { return std::min(x, y); }, a, b));
  add_both(rows, binary(
                     "maximum", maximum, [](double x, double y) { return std::max(x, y); }, a, b));
  add_both(rows, second(binary(
                     "pow", pow, [](double x, double y) { return std::pow(x, y); }, positive, b)));
  add_both(rows, second(binary(
                     "atan2", atan2, [](double x, double y) { return std::atan2(x, y); }, positive, a)));
}

void add_choices(OpCases& rows) {
  rows.push_back({.op = "where",
                  .inputs = {below({5, 7}, 2), normal({5, 1}), normal({7})},
                  .run = [](const Tensors& in) { return where(in[0], in[1], in[2]); },
                  .reference = elementwise([](const double* x) { return x[0] != 0 ? x[1] : x[2]; }),
                  .zero = {{0, 7}, {1, 7}, {7}}});
  rows.push_back({.op = "clamp",
                  .inputs = {normal({5, 7}), between({7}, -1, -0.5), between({5, 1}, 0, 1)},
                  .run = [](const Tensors& in) { return clamp(in[0], in[1], in[2]); },
                  .reference = elementwise([](const double* x) { return std::min(std::max(x[0], x[1]), x[2]); })});
  rows.push_back({.op = "stop_gradient",
                  .inputs = {normal({5, 7}), constant(normal({5, 7}))},
                  .run = [](const Tensors& in) { return stop_gradient(in[0]) * in[1]; },
                  .reference = elementwise([](const double* x) { return x[0] * x[1]; }),
                  .gradient = false});
}

/// Several ops at once: shared values, scalars, an epilogue on a reduction; this is what fusion cuts apart.
void add_fused(OpCases& rows) {
  rows.push_back(second({.op = "fused",
                         .label = "shared values",
                         .inputs = {normal({5, 7}), normal({7})},
                         .run =
                             [](const Tensors& in) {
                               const Tensor shared = tanh(in[0] * in[1] + 0.5f);
                               return shared * sigmoid(in[0]) + 2.f * shared - in[1] / 3.f;
                             },
                         .reference = elementwise([](const double* x) {
                           const double shared = std::tanh(x[0] * x[1] + 0.5);
                           return shared * sigmoid_of(x[0]) + 2 * shared - x[1] / 3;
                         })}));
  rows.push_back({.op = "fused",
                  .label = "reduction between",
                  .inputs = {normal({5, 7})},
                  .run =
                      [](const Tensors& in) {
                        return exp(in[0] - mean(square(in[0]), {{-1}, true})) * 0.5f;
                      },
                  .reference =
                      [](const HostArrays& in) {
                        return from_index(in[0].shape, [&](const Shape& i) {
                          double total = 0;
                          for (int64_t k = 0; k < 7; k++) total += in[0].at({i[0], k}) * in[0].at({i[0], k});
                          return std::exp(in[0].at(i) - total / 7) * 0.5;
                        });
                      }});
}

}  // namespace

void add_pointwise_cases(OpCases& rows) {
  add_unary(rows);
  add_ends(rows);
  add_far(rows);
  add_binary(rows);
  add_choices(rows);
  add_fused(rows);
}

}  // namespace cloam
