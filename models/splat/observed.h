// What the views of the last steps said about each gaussian.
#pragma once
#include "models/io/safetensors.h"
#include "models/splat/draw.h"
#include "models/splat/growth.h"

namespace cloam {

class Observed {
 public:
  /// Of so many gaussians nothing is known.
  void restart(int64_t count);
  /// A view, pending, until take() counts it. by_means: d loss / d what Drawn::seen holds of the means, [G,2] or more
  /// columns; empty: none.
  void add(const Drawn& drawn, const Tensor& by_means);
  /// What is to be evaluated with the step.
  Tensors pending() const { return {gradient_sums_, views_}; }
  /// Of the view, to be evaluated, too: what several views add up.
  Tensors of_view() const { return {gradient_, listed_}; }
  void take();
  GrowthStatistics statistics() const;
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  Tensor gradient_sums_, views_;  // [G]
  Tensor gradient_, listed_;      // [G] of the last view; empty once it is counted
};

}  // namespace cloam
