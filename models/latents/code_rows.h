// Codes of actors in a training that sees one image: where they lie, and what its first steps may do with them.
#pragma once
#include <vector>

#include "models/io/safetensors.h"
#include "models/latents/code_denoiser.h"
#include "models/train/method.h"

namespace cloam {

/// Codes of actors as rows of a parameter [A,W], the means in the first columns.
struct CodeRows {
  Tensor own;
  std::vector<int32_t> rows;
  Condition condition;  // of the rows

  /// Sets the codes of `rows`, one after another.
  void write(const std::vector<float>& codes) const;
  /// Takes the codes' gradients out of those of the rendering (`wanted`: what they are of) and returns those by the
  /// rows' means [N,numbers]; empty: no actor was met.
  Tensor take_gradient(Step& rendering, const Tensors& wanted, int64_t numbers) const;
};

/// The first steps of a training, from step 1 on, in which the optimiser leaves the codes alone.
class CodeStart {
 public:
  virtual ~CodeStart() = default;
  /// Whether training step `step`, counted from 1, is one of them.
  virtual bool includes(int64_t step) const = 0;
  /// Before a step is rendered.
  virtual void show(int64_t step) = 0;
  /// Takes the codes' gradients out of those of the rendering. `wanted`: what they are of.
  virtual void take(Step& rendering, const Tensors& wanted) = 0;
  /// After the step.
  virtual void advance(int64_t step) = 0;
  virtual TensorMap state() const { return {}; }
  virtual void restore(const TensorMap&) {}
};

}  // namespace cloam
