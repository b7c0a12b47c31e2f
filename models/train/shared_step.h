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

/// Takes the steps of one training. Of the sum of gradients each rank has its share of rows, makes Adam's step of those
/// and gives the others what became of them (ZeRO-1: Rajbhandari et al. 2020). Their moments it keeps to itself.
class SharedSteps {
 public:
  /// Fault::usage for several shares under CLOAM_DEBUG=float64: the host adds floats.
  explicit SharedSteps(const Sharing& sharing = {});
  /// Loss, gradients, and the optimiser's step: the same bits for N ranks as for N shares on one. Of one share nothing
  /// is read back but loss and figures. Fault::data on all ranks where one finds what it reads damaged.
  TakenStep take(Method& method, Optimiser& optimiser, const Progress& progress);
  /// Moments of all rows on every rank, for what saves them or moves rows. All ranks call it.
  void gather_moments(Optimiser& optimiser);

 private:
  Sharing sharing_;
  std::vector<OrderedSum> gradients_;  // by buffer
  OrderedSum sums_;                    // of all that a step sums besides, one behind the other
  bool moments_apart_ = false;
};

}  // namespace cloam
