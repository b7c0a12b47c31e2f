// One image to actors: all codes of the actors in the image are denoised together, from what is usual (or a draw) to
// what the prior knows of actors, while the rendering of their composite guides them. What hides behind another actor
// gets its share of the guidance from the composite alone, that is, none.
#pragma once
#include "models/io/safetensors.h"
#include "models/latents/code_denoiser.h"
#include "models/latents/code_prior.h"

namespace cloam {

/// Codes of actors as rows of a parameter. own: [A,W], the means in the first columns; common: [1,W], added to each
/// row; empty: nothing is.
struct CodeRows {
  Tensor own, common;
  std::vector<int32_t> rows;
  Condition condition;  // of the rows
};

/// Each training step is a step of DDIM; the optimiser leaves the codes alone meanwhile. Gradients of the rendering go
/// through the denoiser to x_t, so that what the image shows of an actor tells of all that the prior knows to go with
/// it.
class CodeDenoising {
 public:
  /// Fault::usage unless options.steps is 1 to the times of the schedule.
  CodeDenoising(const CodeDenoiser& denoiser, const CodePriorOptions& options, CodeRows rows, uint64_t seed);
  /// Whether training step `step`, counted from 1, is one of it.
  bool includes(int64_t step) const { return step <= static_cast<int64_t>(times_.size()); }
  /// Before a step is rendered: the codes become the estimate x^.
  void show(int64_t step);
  /// Takes the codes' gradients out of those of the rendering. `wanted`: what they are of.
  void take(Step& rendering, const Tensors& wanted);
  /// Corrects x^ by the gradient that was taken, leaves it as the codes, and goes on to the next level.
  void advance(int64_t step);
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  Level level(size_t step) const;
  Tensor clean(const Tensor& noisy, int64_t step) const;
  void write(const Tensor& standardised);

  CodeDenoiser denoiser_;
  CodePriorOptions options_;
  CodeRows rows_;
  std::vector<int64_t> times_;
  Tensor noisy_, clean_, gradient_;  // [N,C,side,side], standardised; gradient_ empty: no actor was met
};

}  // namespace cloam
