// Rows of pointwise ops on integers, masks and casts.
#include <cmath>

#include "tests/op_cases/cases.h"

namespace cloam {
namespace {

using BinaryOp = Tensor (*)(const Tensor&, const Tensor&);
using BinaryTruth = double (*)(double, double);

OpCase integers(const char* op, BinaryOp run, BinaryTruth truth) {
  const std::vector<double> a = {-17, -8, -1, 0, 1, 9, 23, 1 << 25, -(1 << 25), 5, 5, 100003},
                            b = {5, -3, 7, 2, 1, 9, -4, 3, 7, 5, 6, -1};
  return {.op = op,
          .label = "int32",
          .inputs = {given({3, 4}, a, DType::i32), given({3, 4}, b, DType::i32)},
          .run = [run](const Tensors& in) { return run(in[0], in[1]); },
          .reference = elementwise([truth](const double* x) { return truth(x[0], x[1]); }),
          .result = DType::i32,
          .gradient = false,
          .relative = true,
          .tolerance = 0};
}

OpCase mask(const char* op, BinaryOp run, BinaryTruth truth) {
  OpCase row = integers(op, run, truth);
  row.label = "floats";
  row.inputs = {given({2, 4}, {-1.5, 0, 0, 2, 1e-30, 3, -2, 7}), given({2, 4}, {-1.5, -0.0, 1, 1, 0, 3, 2, 8})};
  return row;
}

OpCase casting(const char* label, DType from, DType to, const std::vector<double>& values, double (*truth)(double)) {
  return {.op = "cast",
          .label = label,
          .inputs = {given({static_cast<int64_t>(values.size())}, values, from)},
          .run = [to](const Tensors& in) { return cast(in[0], to); },
          .reference = elementwise([truth](const double* x) { return truth(x[0]); }),
          .result = to,
          .gradient = false,
          .relative = true,
          .tolerance = 0};
}

void add_casts(OpCases& rows) {
  const auto same = [](double x) { return x; };
  rows.push_back(casting("to int32", DType::f32, DType::i32, {-2.7, -0.5, 0, 0.5, 2.7, 1e6},
                         [](double x) { return std::trunc(x); }));
  rows.push_back(casting("of int32", DType::i32, DType::f32, {-3, 0, 7, 1 << 24}, same));
  rows.push_back(casting("of uint8", DType::u8, DType::f32, {0, 1, 128, 255}, same));
  rows.push_back(casting("to uint8", DType::i32, DType::u8, {0, 1, 128, 255}, same));
  rows.push_back(casting("of uint32", DType::u32, DType::f32, {0, 1, 2147483648.0, 4294967040.0}, same));
  OpCase half = casting("to float16", DType::f32, DType::f16, {0, 1, -2.5, 1000.25, 0.1, -6e-5, 65504}, same);
  half.tolerance = 5e-4;
  half.gradient = true;
  rows.push_back(half);
  const std::vector<double> edges = {
      0,           2049,        2051,          -2051,         2048.9,  0x1p-24, 0x1p-25, 0x3p-25, 0x1.8p-26, -0x5p-25,
      0x1.ffep-15, 0x1.ffcp-15, 1.00048828125, 1.00146484375, 65519.9, 65520,   -65520,  1e9,     -1e30,     0.1};
  rows.push_back(casting("to float16, rounded", DType::f32, DType::f16, edges, rounded_to_half));
  rows.push_back(casting("to float16 and back", DType::f32, DType::f32, edges, rounded_to_half));
  rows.back().run = [](const Tensors& in) { return cast(cast(in[0], DType::f16), DType::f32); };
}

}  // namespace

void add_integer_cases(OpCases& rows) {
  rows.push_back(integers("add", operator+, [](double a, double b) { return a + b; }));
  rows.push_back(integers("subtract", operator-, [](double a, double b) { return a - b; }));
  rows.push_back(integers("multiply", operator*, [](double a, double b) { return a * b; }));
  rows.push_back(integers("divide", operator/, [](double a, double b) { return std::trunc(a / b); }));
  rows.push_back(integers("modulo", modulo, [](double a, double b) { return std::fmod(a, b); }));
  rows.push_back(integers("bit_xor", bit_xor, [](double a, double b) {
    return static_cast<double>(static_cast<int32_t>(a) ^ static_cast<int32_t>(b));
  }));
  rows.push_back(integers("minimum", minimum, [](double a, double b) { return std::min(a, b); }));
  rows.push_back(integers("maximum", maximum, [](double a, double b) { return std::max(a, b); }));
  rows.push_back(integers("less", operator<, [](double a, double b) { return double(a < b); }));
  rows.push_back(mask("less", operator<, [](double a, double b) { return double(a < b); }));
  rows.push_back(mask("greater", operator>, [](double a, double b) { return double(a > b); }));
  rows.push_back(mask("less_equal", operator<=, [](double a, double b) { return double(a <= b); }));
  rows.push_back(mask("equal", equal, [](double a, double b) { return double(a == b); }));
  rows.push_back({.op = "where",
                  .label = "int32",
                  .inputs = {below({4, 3}, 2), below({4, 3}, 100), below({3}, 100)},
                  .run = [](const Tensors& in) { return where(in[0], in[1], in[2]); },
                  .reference = elementwise([](const double* x) { return x[0] != 0 ? x[1] : x[2]; }),
                  .result = DType::i32,
                  .gradient = false,
                  .tolerance = 0});
  add_casts(rows);
}

}  // namespace cloam
