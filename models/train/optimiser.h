// Adam over a named set of parameters; its state lies under the same names.
#pragma once
#include "models/train/method.h"
#include "runtime/flat.h"
#include "runtime/ops.h"

namespace cloam {

class Optimiser {
 public:
  /// Zero moments for every parameter; rows of `sparse` ones count their own steps. Parameters with one learning rate
  /// move into one buffer, so that a step is one launch for all of them.
  Optimiser(const Params& parameters, const std::vector<LearningRate>& rates);
  /// Before the gradients (in the order of the map) are evaluated: they shall lie where step() reads them, which saves
  /// copies. They hold until the next step's are evaluated.
  void expect(const Tensors& gradients) const;
  /// One step (counted from 1) in place.
  void step(Params& parameters, const Tensors& gradients, const std::vector<LearningRate>& rates,
            const AdamSettings& adam, int64_t step);
  /// Tensors "m.NAME", "v.NAME", "steps.NAME".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  struct Group {
    std::string prefix;         // of the learning rate
    std::vector<size_t> order;  // places of its parameters in the map
    Flat parameters, m, v, gradients;
  };
  void add_group(const std::string& prefix, const Params& parameters, const std::vector<LearningRate>& rates);
  void step_group(Group& group, const Tensors& parameters, const Tensors& gradients, const AdamStep& with);

  std::vector<Group> groups_;
  Params m_, v_, steps_;
};

/// The rate whose prefix fits a name best.
const LearningRate& rate_of(const std::string& name, const std::vector<LearningRate>& rates);

}  // namespace cloam
