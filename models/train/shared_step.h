// A step of training whose batch is split into shares: each rank takes some, one after the other, and all get the sum.
#pragma once
#include "models/train/method.h"
#include "models/train/optimiser.h"
#include "models/train/ranks.h"

namespace cloam {

/// Rank r of N takes the shares r, r + N, r + 2 N ...
struct Sharing {
  const Ranks& ranks = alone();
  int64_t shares = 1;  // a multiple of the ranks
};

/// What a step was, as means over its shares; a figure over those that have it.
struct TakenStep {
  double loss = 0;
  std::map<std::string, double> figures = {};
};

/// Evaluates loss, gradients, figures and the rest together.
void eval_step(const Step& step);

/// Takes the steps of one training.
class SharedSteps {
 public:
  explicit SharedSteps(const Sharing& sharing = {})
      : sharing_(sharing), gradients_(sharing.ranks), sums_(sharing.ranks) {}
  /// Loss, gradients, and the optimiser's step: the same bits for N ranks as for N shares on one. Of one share nothing
  /// is read back but loss and figures.
  TakenStep take(Method& method, Optimiser& optimiser, const Progress& progress);

 private:
  Sharing sharing_;
  OrderedSum gradients_, sums_;
};

}  // namespace cloam
