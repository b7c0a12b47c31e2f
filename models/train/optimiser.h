// Adam over a named set of parameters; its state lies under the same names.
#pragma once
#include "models/train/method.h"

namespace cloam {

class Optimiser {
 public:
  /// Zero moments for every parameter; rows of `sparse` ones count their own steps.
  Optimiser(const Params& parameters, const std::vector<LearningRate>& rates);
  /// One step (counted from 1) in place. gradients: evaluated, in the order of the map.
  void step(Params& parameters, const Tensors& gradients, const std::vector<LearningRate>& rates,
            const AdamSettings& adam, int64_t step);
  /// Tensors "m.NAME", "v.NAME", "steps.NAME".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  Params m_, v_, steps_;
};

/// The rate whose prefix fits a name best.
const LearningRate& rate_of(const std::string& name, const std::vector<LearningRate>& rates);

}  // namespace cloam
