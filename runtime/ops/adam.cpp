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

void check(const char* op, const Tensor& parameter, const Tensor& m, const Tensor& v, const Tensor& gradient) {
  check_state(op, parameter, m, "m");
  check_state(op, parameter, v, "v");
  check_state(op, parameter, gradient, "the gradient");
  for (const Tensor& leaf : {parameter, m, v}) own(leaf);
}

AdamStep::Rows rows_of(const char* op, const Tensor& parameter, const AdamStep& with) {
  const int64_t count = parameter.rank() > 0 ? parameter.dim(0) : 1;
  const AdamStep::Rows rows = with.rows.value_or(AdamStep::Rows{0, count});
  if (rows.begin < 0 || rows.begin > rows.end || rows.end > count)
    throw Error(Fault::internal, text("[", op, "] rows ", rows.begin, " to ", rows.end, " of the parameter ",
                                      to_string(parameter.shape())));
  return rows;
}

float shrink_of(const AdamStep& with) {
  return static_cast<float>(1.0 - double{with.learning_rate} * with.weight_decay);
}

}  // namespace

void adam_step(Tensor& parameter, Tensor& m, Tensor& v, const Tensor& gradient, const AdamStep& with) {
  check("adam_step", parameter, m, v, gradient);
  if (with.step < 1) throw Error(Fault::internal, text("[adam_step] step ", with.step, ", want 1 for the first"));
  const auto steps = static_cast<double>(with.step);
  const double left1 = 1 - std::pow(double{with.beta1}, steps), left2 = 1 - std::pow(double{with.beta2}, steps);
  const AdamStep::Rows rows = rows_of("adam_step", parameter, with);
  const int64_t width = row_width(parameter.shape()), first = rows.begin * width, count = rows.end * width - first;
  if (count == 0) return;
  const WorkShare work = share(count, 4096);
  launch(kernel("adam", "adam"), "adam", work.range, parameter, m, v, dense(gradient), first, count, with.beta1,
         with.beta2, static_cast<float>(with.learning_rate / left1), static_cast<float>(1 / std::sqrt(left2)),
         with.epsilon, shrink_of(with), work.chunk);
}

void adam_step_rows(Tensor& parameter, Tensor& m, Tensor& v, Tensor& row_steps, const Tensor& gradient,
                    const AdamStep& with) {
  check("adam_step_rows", parameter, m, v, gradient);
  if (parameter.rank() == 0 || !(row_steps.shape() == Shape{parameter.dim(0)}) || row_steps.dtype() != DType::i32)
    throw Error(Fault::internal,
                text("[adam_step_rows] row_steps is ", to_string(row_steps.shape()), " ", name_of(row_steps.dtype()),
                     " for a parameter ", to_string(parameter.shape()), ": want int32, one a row"));
  const AdamStep::Rows own_rows = rows_of("adam_step_rows", parameter, with);
  const int64_t rows = own_rows.end - own_rows.begin, width = row_width(parameter.shape());
  if (rows * width == 0) return;
  own(row_steps);
  const auto log_of = [](float beta) { return static_cast<float>(std::log(double{beta})); };
  const WorkShare work = share(rows, 4096 / width);
  launch(kernel("adam", "adam_rows"), "adam_rows", work.range, parameter, m, v, row_steps, dense(gradient),
         own_rows.begin, rows, width, with.beta1, with.beta2, log_of(with.beta1), log_of(with.beta2),
         with.learning_rate, with.epsilon, shrink_of(with), work.chunk);
}

}  // namespace cloam
