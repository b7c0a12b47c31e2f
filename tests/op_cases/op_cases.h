// One row an op: how to call it, and a float64 reference that shares no code with the kernels. The suite, selftest and
// the benchmarks read the same rows. A registered op without a row fails the suite.
//
// To add an op: write a row in the family's *_cases.cpp (a new file: name its function in cases.h and op_cases.cpp):
//   rows.push_back({.op = "relu",                        // the name given to Registered, or that of a composition
//                   .label = "",                         // what sets this row apart from others of the op
//                   .inputs = {normal({5, 7})},          // odd sizes; see the makers below
//                   .run = [](const Tensors& in) { return relu(in[0]); },
//                   .reference = elementwise([](const double* x) { return std::max(0.0, x[0]); })});
// check() then tests the values, the gradient of sum(y * weight) against central differences of the reference, both
// again for inputs that lie transposed and as every second element of a larger tensor, and (if .zero is given) empty
// tensors. An op with several results has a row for each, or joins them in run.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "runtime/ops.h"
#include "tests/op_cases/host_array.h"

namespace cloam {

/// Where an input's values come from: seeded by the row's name, so that a row is the same on every machine.
struct InputSpec {
  enum Kind { kNormal, kUniform, kDistinct, kBelow, kGiven };
  Shape shape;
  Kind kind = kNormal;
  double low = 0, high = 1;  // of kUniform; kBelow: integers in [low, high)
  DType dtype = DType::f32;
  bool differentiable = true;      // float inputs only
  std::vector<double> given = {};  // of kGiven, row-major
};
InputSpec normal(const Shape& shape);
InputSpec between(const Shape& shape, double low, double high);
InputSpec halves(const Shape& shape);    // normal numbers in float16
InputSpec distinct(const Shape& shape);  // no two values closer than 0.01: extrema have one place
InputSpec below(const Shape& shape, int64_t high, DType dtype = DType::i32);  // integers in [0, high)
InputSpec given(const Shape& shape, const std::vector<double>& values, DType dtype = DType::f32);
InputSpec constant(InputSpec spec);  // a float input that no gradient is asked of

using Reference = std::function<HostArray(const std::vector<HostArray>&)>;

struct OpCase {
  std::string op, label = {};
  std::vector<InputSpec> inputs = {};
  std::function<Tensor(const Tensors&)> run = {};
  Reference reference = {};
  DType result = DType::f32;
  bool gradient = true;          // of every differentiable float input
  bool second_order = false;     // the gradient of the gradient as well
  bool strided_gradient = true;  // off where the gradient's kernels differ from other rows' in their text alone
  bool relative = false;         // measure each value against itself, not against the mean of all
  bool composed = false;         // some devices run a composition in the op's place
  double tolerance = 1e-5, gradient_tolerance = 1e-4;
  std::vector<Shape> zero = {};       // shapes of the inputs with no elements, where the op allows that
  std::vector<InputSpec> bench = {};  // inputs of the benchmark
  double bench_flops = 0;             // of one forward pass over them
  std::string name() const { return label.empty() ? op : op + ": " + label; }
};

/// Every row, grouped by family.
const std::vector<OpCase>& op_cases();

enum class Thorough { quick, full };  // quick: dense inputs only, half as many gradients

struct CaseResult {
  double forward_error = 0, gradient_error = 0;  // relative; see OpCase::relative
  std::string worst;                             // where, what was found and what was wanted; empty when all is well
  bool passed = false;
};
/// Runs one row on the chosen device. An op that throws is a failed row, never an exception.
CaseResult check(const OpCase& row, Thorough how);

/// Device tensors for a row's inputs (of .inputs or .bench); differentiable ones are parameters.
Tensors make_inputs(const OpCase& row, const std::vector<InputSpec>& specs);

}  // namespace cloam
