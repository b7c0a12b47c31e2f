// The Adam step in place: one launch a parameter, no new memory.
#include "runtime/ops/adam.h"

#include <cmath>

#include "runtime/ops.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

void check_state(const char* op, const Tensor& parameter, const Tensor& state, const char* what) {
  if (!(state.shape() == parameter.shape()) || state.dtype() != DType::f32 || parameter.dtype() != DType::f32)
    throw Error(Fault::internal, text("[", op, "] ", what, " is ", to_string(state.shape()), " ",
                                      name_of(state.dtype()), ", the parameter ", to_string(parameter.shape()), " ",
                                      name_of(parameter.dtype()), ": want float32 of one shape"));
}

/// Gives a tensor values of its own: zeros() is a view of one number.
void own(const Tensor& leaf) { leaf.node()->storage = dense(leaf).node()->storage; }

void check_rows(const char* op, const Tensor& parameter, const Tensor& gradient, int64_t first) {
  Shape rows = parameter.shape();
  if (rows.rank() > 0 && gradient.rank() > 0) rows[0] = gradient.dim(0);
  if (rows.rank() == 0 || !(gradient.shape() == rows) || first < 0 || first + rows[0] > parameter.dim(0) ||
      gradient.dtype() != DType::f32)
    throw Error(Fault::internal,
                text("[", op, "] the gradient ", to_string(gradient.shape()), " ", name_of(gradient.dtype()),
                     " does not fit the rows from ", first, " on of the parameter ", to_string(parameter.shape())));
}

void check(const char* op, const Tensor& parameter, const Tensor& m, const Tensor& v, const Tensor& gradient,
           const AdamStep& with) {
  check_state(op, parameter, m, "m");
  check_state(op, parameter, v, "v");
  if (with.first_row)
    check_rows(op, parameter, gradient, *with.first_row);
  else
    check_state(op, parameter, gradient, "the gradient");
  for (const Tensor& leaf : {parameter, m, v}) own(leaf);
}

float shrink_of(const AdamStep& with) {
  return static_cast<float>(1.0 - double{with.learning_rate} * with.weight_decay);
}

}  // namespace

void adam_step(Tensor& parameter, Tensor& m, Tensor& v, const Tensor& gradient, const AdamStep& with) {
  check("adam_step", parameter, m, v, gradient, with);
  if (with.step < 1) throw Error(Fault::internal, text("[adam_step] step ", with.step, ", want 1 for the first"));
  const auto steps = static_cast<double>(with.step);
  const double left1 = 1 - std::pow(double{with.beta1}, steps), left2 = 1 - std::pow(double{with.beta2}, steps);
  const int64_t count = gradient.numel(), first = with.first_row.value_or(0) * row_width(parameter.shape());
  if (count == 0) return;
  const WorkShare work = share(count, 4096);
  launch(kernel("adam", "adam"), "adam", work.range, parameter, m, v, dense(gradient), first, count, with.beta1,
         with.beta2, static_cast<float>(with.learning_rate / left1), static_cast<float>(1 / std::sqrt(left2)),
         with.epsilon, shrink_of(with), work.chunk);
}

void adam_step_rows(Tensor& parameter, Tensor& m, Tensor& v, Tensor& row_steps, const Tensor& gradient,
                    const AdamStep& with) {
  check("adam_step_rows", parameter, m, v, gradient, with);
  if (parameter.rank() == 0 || !(row_steps.shape() == Shape{parameter.dim(0)}) || row_steps.dtype() != DType::i32)
    throw Error(Fault::internal,
                text("[adam_step_rows] row_steps is ", to_string(row_steps.shape()), " ", name_of(row_steps.dtype()),
                     " for a parameter ", to_string(parameter.shape()), ": want int32, one a row"));
  if (gradient.numel() == 0) return;
  own(row_steps);
  const auto log_of = [](float beta) { return static_cast<float>(std::log(double{beta})); };
  const int64_t rows = gradient.dim(0), width = row_width(parameter.shape());
  const WorkShare work = share(rows, 4096 / width);
  launch(kernel("adam", "adam_rows"), "adam_rows", work.range, parameter, m, v, row_steps, dense(gradient),
         with.first_row.value_or(0), rows, width, with.beta1, with.beta2, log_of(with.beta1), log_of(with.beta2),
         with.learning_rate, with.epsilon, shrink_of(with), work.chunk);
}

}  // namespace cloam
