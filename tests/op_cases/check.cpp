// Runs one row: values and gradients on the device against float64 on the host.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "runtime/error.h"
#include "runtime/op.h"
#include "tests/op_cases/inputs.h"

namespace cloam {
namespace {

constexpr size_t kProbes = 40, kQuickProbes = 20;  // elements of an input whose gradient is compared, at most

/// What the host says, for one set of inputs.
struct Truth {
  HostArrays in;
  HostArray out, weight;                    // the loss is sum(out * weight)
  std::vector<std::vector<size_t>> probes;  // per input: the elements whose gradients are known
  HostArrays first, second;                 // gradients at the probes; second: of sum(first * direction)
  HostArrays direction;
};

struct Judge {
  const OpCase& row;
  CaseResult result;
  bool failed = false;

  void fail(const std::string& why) {
    if (!failed) result.worst = why;
    failed = true;
  }
  void value(const std::string& what, double found, double wanted, double scale, double& worst, double tolerance) {
    double error = std::abs(found - wanted) / (std::abs(wanted) + scale + 1e-30);
    if (found == wanted || (std::isnan(found) && std::isnan(wanted))) error = 0;
    if (std::isnan(error)) error = INFINITY;
    worst = std::max(worst, error);
    if (!(error <= tolerance)) fail(text(what, ": found ", found, ", want ", wanted, " (relative error ", error, ")"));
  }
};

double mean_size(const HostArray& array) {
  double total = 0;
  for (double value : array.values) total += std::isfinite(value) ? std::abs(value) : 0;
  return array.values.empty() ? 0 : total / static_cast<double>(array.size());
}

bool differentiable(const OpCase& row, size_t i) {
  return row.gradient && row.inputs[i].differentiable && is_float(row.inputs[i].dtype);
}

double loss_of(const OpCase& row, const HostArrays& in, const HostArray& weight) {
  const HostArray out = row.reference(in);
  double total = 0;
  for (size_t i = 0; i < out.values.size(); i++) total += out.values[i] * weight.values[i];
  return total;
}

std::vector<size_t> choose_probes(size_t count, size_t most, Numbers& numbers) {
  std::vector<size_t> probes;
  if (count <= most)
    for (size_t i = 0; i < count; i++) probes.push_back(i);
  else
    for (size_t i = 0; i < most; i++) probes.push_back(static_cast<size_t>(numbers.below(static_cast<int64_t>(count))));
  return probes;
}

double first_difference(const OpCase& row, Truth& truth, size_t input, size_t element) {
  double& x = truth.in[input].values[element];
  const double at = x, step = 1e-5 * std::max(1.0, std::abs(at));
  x = at + step;
  const double up = loss_of(row, truth.in, truth.weight);
  x = at - step;
  const double down = loss_of(row, truth.in, truth.weight);
  x = at;
  return (up - down) / (2 * step);
}

/// d2 loss / d element d direction, from four corners.
double second_difference(const OpCase& row, const Truth& truth, size_t input, size_t element) {
  constexpr double kStep = 2e-4;
  double total = 0;
  for (int corner = 0; corner < 4; corner++) {
    HostArrays in = truth.in;
    const double along = corner & 1 ? -kStep : kStep, own = corner & 2 ? -kStep : kStep;
    for (size_t i = 0; i < in.size(); i++)
      for (size_t k = 0; k < truth.direction[i].values.size(); k++)
        in[i].values[k] += along * truth.direction[i].values[k];
    in[input].values[element] += own;
    total += (corner == 0 || corner == 3 ? 1 : -1) * loss_of(row, in, truth.weight);
  }
  return total / (4 * kStep * kStep);
}

/// Gradients at the probes, on all of the host's cores: this is where the time of a row goes.
void differentiate(const OpCase& row, Truth& truth) {
  std::vector<std::pair<size_t, size_t>> jobs;  // input, probe
  for (size_t i = 0; i < truth.probes.size(); i++)
    for (size_t p = 0; p < truth.probes[i].size(); p++) jobs.emplace_back(i, p);
  std::atomic<size_t> next = 0;
  const auto work = [&](Truth own) {
    for (size_t k = next++; k < jobs.size(); k = next++) {
      const auto [i, p] = jobs[k];
      truth.first[i].values[p] = first_difference(row, own, i, own.probes[i][p]);
      if (row.second_order) truth.second[i].values[p] = second_difference(row, own, i, own.probes[i][p]);
    }
  };
  std::vector<std::thread> others;
  for (unsigned k = 1; k < std::min<size_t>(std::thread::hardware_concurrency(), jobs.size()); k++)
    others.emplace_back(work, truth);
  work(truth);
  for (std::thread& other : others) other.join();
}

Truth truth_of(const OpCase& row, const std::vector<InputSpec>& specs, size_t probes) {
  Truth truth;
  for (size_t i = 0; i < specs.size(); i++) truth.in.push_back(host_input(specs[i], row.name() + std::to_string(i)));
  truth.out = row.reference(truth.in);
  truth.weight = host_input(normal(truth.out.shape), row.name() + "weight");
  Numbers numbers(row.name() + "probes");
  for (size_t i = 0; i < specs.size(); i++) {
    truth.probes.push_back(differentiable(row, i) ? choose_probes(truth.in[i].values.size(), probes, numbers)
                                                  : std::vector<size_t>{});
    const auto count = static_cast<int64_t>(truth.probes[i].size());
    truth.first.emplace_back(Shape{count});
    truth.second.emplace_back(Shape{count});
    truth.direction.push_back(differentiable(row, i)
                                  ? host_input(normal(specs[i].shape), row.name() + "direction" + std::to_string(i))
                                  : HostArray(Shape{0}));
  }
  differentiate(row, truth);
  return truth;
}

/// Whether the graph of `t` holds an op of this name: a row cannot stand for an op that it does not run.
bool holds_op(const Tensor& t, const std::string& name) {
  if (!t.node()->op) return false;
  if (t.node()->op->name() == name) return true;
  const Tensors& in = t.node()->in;
  return std::any_of(in.begin(), in.end(), [&](const Tensor& input) { return holds_op(input, name); });
}

void check_holds(const OpCase& row, const Tensor& out, Judge& judge) {
  const auto& names = registered_ops();
  const bool registered = std::find(names.begin(), names.end(), row.op) != names.end();
  if (registered && !row.composed && !holds_op(out, row.op))
    judge.fail(text("the graph of this row holds no op ", row.op));
}

void compare(Judge& judge, const char* what, const HostArray& found, const HostArray& wanted) {
  if (!(found.shape == wanted.shape))
    return judge.fail(text(what, ": shape ", to_string(found.shape), ", want ", to_string(wanted.shape)));
  const double scale = judge.row.relative ? 0 : mean_size(wanted);
  for (int64_t i = 0; i < found.size(); i++)
    judge.value(text(what, " at element ", i), found[i], wanted[i], scale, judge.result.forward_error,
                judge.row.tolerance);
}

void compare_probes(Judge& judge, const std::string& what, const HostArray& found, const HostArray& wanted,
                    const std::vector<size_t>& probes, double least_scale = 0) {
  const double scale = std::max(mean_size(wanted), least_scale);
  for (size_t p = 0; p < probes.size(); p++)
    judge.value(text(what, " at element ", probes[p]), found.values[probes[p]], wanted.values[p], scale,
                judge.result.gradient_error, judge.row.gradient_tolerance);
}

struct Gradients {
  std::vector<size_t> of;  // places among the inputs
  Tensors first, second;
};

Gradients gradients(const OpCase& row, const Truth& truth, const Tensors& in, const Tensor& out, bool second) {
  Gradients g;
  Tensors wrt;
  for (size_t i = 0; i < in.size(); i++)
    if (differentiable(row, i)) g.of.push_back(i), wrt.push_back(in[i]);
  if (wrt.empty() || truth.out.size() == 0) return {};
  const auto weighted = [](const Tensor& x, const HostArray& by) {
    return sum(x * on_device(by, constant(normal(by.shape)), Lie::dense));
  };
  g.first = grad(weighted(out, truth.weight), wrt);
  if (!second) return g;
  Tensor along;
  for (size_t i = 0; i < wrt.size(); i++) {
    const Tensor part = weighted(g.first[i], truth.direction[g.of[i]]);
    along = along ? along + part : part;
  }
  g.second = grad(along, wrt);
  return g;
}

/// One layout of the inputs, and what the device will make of them.
struct Trial {
  Lie lie;
  Tensor out;
  Gradients gradients;
};

Trial trial(const OpCase& row, const Truth& truth, Lie lie, bool with_gradients, Judge& judge) {
  Tensors in;
  for (size_t i = 0; i < row.inputs.size(); i++) in.push_back(on_device(truth.in[i], row.inputs[i], lie));
  Trial out{lie, row.run(in), {}};
  check_holds(row, out.out, judge);
  if (out.out.dtype() != row.result)
    judge.fail(text("the result is ", name_of(out.out.dtype()), ", want ", name_of(row.result)));
  if (with_gradients) out.gradients = gradients(row, truth, in, out.out, row.second_order && lie == Lie::dense);
  return out;
}

/// All layouts as one plan: its kernels compile as one program, which is most of what a row costs.
void evaluate(const std::vector<Trial>& trials) {
  Tensors all;
  for (const Trial& t : trials) {
    all.push_back(t.out);
    all.insert(all.end(), t.gradients.first.begin(), t.gradients.first.end());
    all.insert(all.end(), t.gradients.second.begin(), t.gradients.second.end());
  }
  eval(all);
}

void judge_trial(const Truth& truth, const Trial& trial, Judge& judge) {
  const std::string where = text(name_of(trial.lie), " inputs");
  compare(judge, ("value, " + where).c_str(), host_output(trial.out), truth.out);
  const Gradients& g = trial.gradients;
  double least_second = 0;  // where an input's second gradient is zero, its differences are noise of the others' size
  for (const HostArray& second : truth.second) least_second = std::max(least_second, mean_size(second));
  for (size_t k = 0; k < g.of.size(); k++) {
    const size_t i = g.of[k];
    const std::string of = text("gradient of input ", i, ", ", where, ",");
    compare_probes(judge, of, host_output(g.first[k]), truth.first[i], truth.probes[i]);
    if (!g.second.empty())
      compare_probes(judge, "second " + of, host_output(g.second[k]), truth.second[i], truth.probes[i], least_second);
  }
}

/// No elements in, no elements out (or the sum of none), and gradients of no elements.
void check_zero(const OpCase& row, Judge& judge) {
  OpCase none = row;
  for (size_t i = 0; i < none.inputs.size(); i++) none.inputs[i].shape = row.zero[i];
  const Truth truth = truth_of(none, none.inputs, kProbes);
  const Trial empty = trial(none, truth, Lie::dense, true, judge);
  evaluate({empty});
  judge_trial(truth, empty, judge);
}

void check_all(const OpCase& row, Thorough how, Judge& judge) {
  const Truth truth = truth_of(row, row.inputs, how == Thorough::full ? kProbes : kQuickProbes);
  std::vector<Trial> trials = {trial(row, truth, Lie::dense, true, judge)};
  if (how == Thorough::full && !row.inputs.empty()) {
    // A vector has no transposed view; its sliced one then brings the gradients.
    const bool axes =
        std::any_of(truth.in.begin(), truth.in.end(), [](const HostArray& x) { return x.shape.rank() > 1; });
    if (axes) trials.push_back(trial(row, truth, Lie::transposed, row.strided_gradient, judge));
    trials.push_back(trial(row, truth, Lie::sliced, !axes && row.strided_gradient, judge));
  }
  evaluate(trials);
  for (const Trial& t : trials) judge_trial(truth, t, judge);
  if (how == Thorough::full && !row.zero.empty()) check_zero(row, judge);
}

}  // namespace

CaseResult check(const OpCase& row, Thorough how) {
  Judge judge{row, {}};
  try {
    check_all(row, how, judge);
  } catch (const std::exception& error) { judge.fail(text("threw: ", error.what())); }
  judge.result.passed = !judge.failed;
  return judge.result;
}

}  // namespace cloam
