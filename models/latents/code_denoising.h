// One image to actors: all codes of the actors in the image are denoised together, from what is usual (or a draw) to
// what the prior knows of actors, while the rendering of their composite guides them. What hides behind another actor
// gets its share of the guidance from the composite alone, that is, none.
#pragma once
#include "models/io/safetensors.h"
#include "models/latents/code_prior.h"
#include "models/latents/code_rows.h"

namespace cloam {

/// Each training step is a step of DDIM; the optimiser leaves the codes alone meanwhile. Gradients of the rendering go
/// through the denoiser to x_t, so that what the image shows of an actor tells of all that the prior knows to go with
/// it.
class CodeDenoising final : public CodeStart {
 public:
  /// Fault::usage unless options.steps is 1 to the times of the schedule.
  CodeDenoising(const CodeDenoiser& denoiser, const CodePriorOptions& options, CodeRows rows, uint64_t seed);
  bool includes(int64_t step) const override { return step <= static_cast<int64_t>(times_.size()); }
  /// The codes become the estimate x^.
  void show(int64_t step) override;
  void take(Step& rendering, const Tensors& wanted) override;
  /// Corrects x^ by the gradient that was taken, leaves it as the codes, and goes on to the next level.
  void advance(int64_t step) override;
  TensorMap state() const override;
  void restore(const TensorMap& state) override;

 private:
  Level level(size_t step) const;
  Tensor clean(const Tensor& noisy, int64_t step) const;
  void write(const Tensor& standardised) const;

  CodeDenoiser denoiser_;
  CodePriorOptions options_;
  CodeRows rows_;
  std::vector<int64_t> times_;
  Tensor noisy_, clean_, gradient_;  // [N,C,side,side], standardised; gradient_ empty: no actor was met
};

}  // namespace cloam
