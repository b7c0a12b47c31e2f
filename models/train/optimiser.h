// Adam over a named set of parameters; its state lies under the same names.
#pragma once
#include "models/io/safetensors.h"
#include "models/nn/params.h"
#include "models/train/grows.h"
#include "models/train/step_memory.h"
#include "runtime/flat.h"
#include "runtime/ops.h"
#include "runtime/ops/adam.h"

namespace cloam {

class Optimiser {
 public:
  /// Zero moments for every parameter that is not frozen; rows of `sparse` ones count their own steps. All others move
  /// into one buffer (several where the device allows none so large), group behind group, so that a step is one launch
  /// a group, and ranks have few buffers to exchange. Ranks of one host whose devices compute in its memory have the
  /// parameters in common, and see each other's gradients; then every rank makes its optimiser at the same place.
  Optimiser(const Params& parameters, const ParameterGroups& groups, const Ranks& ranks = alone());
  /// The parameters to compute gradients of: all that are not frozen, in the order of the map.
  Tensors wanted(const Params& parameters) const;
  /// Before the gradients (in the order of wanted) are evaluated: they shall lie where step() reads them, which saves
  /// copies; they hold until the next step's are evaluated. An empty one of a dense parameter becomes zeros, since its
  /// moments fade all the same; a sparse parameter stands still.
  void expect(Tensors& gradients) const;
  /// Evaluated gradients as few tensors in an order that is fixed: those that lie together, then those of sparse
  /// parameters, empty handles where one stands still.
  Tensors buffers_of(const Tensors& gradients);
  /// What ranks have in common of a buffer, whose gradients hold what buffers_of() put there; null where they do not.
  const StepMemory* in_common(size_t buffer) const;
  bool has_common() const;  // of any
  std::vector<Shape> buffer_shapes() const;
  /// One step in place, with evaluated gradients.
  void step(Params& parameters, const Tensors& gradients, const ParameterGroups& groups, const Progress& progress);
  /// The same with gradients as buffers_of() has them. Only the rows that are this share's are read, and stepped.
  struct RowsStep {
    const ParameterGroups& groups;
    Progress progress;  // the share: of each buffer's rows
  };
  void step_rows(Params& parameters, const Tensors& gradients, const RowsStep& how);
  /// Before a step whose rows ranks share out: parameters that a method replaced lie in the buffers again. Where ranks
  /// have them in common, one that did this later would undo what another has stepped.
  void gather(const Params& parameters) const;
  /// What step_rows() changes and other ranks do not see, in the order of the buffers (empty handles for what they
  /// see), and what it keeps of each row.
  Tensors stepped(const Params& parameters) const;
  Tensors moments() const;
  /// After a method replaced parameters by others of more, fewer or other rows: moments and counts move along.
  void move_rows(const Params& parameters, const RowMoves& moves, const ParameterGroups& groups);
  /// Whether no parameter that it steps is NaN or infinite.
  bool finite(const Params& parameters) const;
  /// Tensors "m.NAME", "v.NAME", "steps.NAME".
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  /// Parameters of one group, side by side in a buffer.
  struct Group {
    std::string prefix;
    size_t begin, end;  // parts
    Tensor parameters, m, v, gradients;
  };
  struct Flats {
    std::vector<Group> groups;
    std::vector<size_t> order;  // places of its parameters among those wanted
    StepMemory memory;
    Flat m, v;
  };
  void make(Flats& flats, const Tensors& parameters);
  void gather_parameters(const Flats& flats, const Tensors& parameters) const;
  void step_own(Flats& flats, const RowsStep& how);
  Tensor in_place(const std::string& name, const Tensor& gradient) const;

  std::vector<std::string> names_;  // not frozen, in the order of the map
  std::vector<Flats> flats_;
  const Ranks* ranks_;
  Params m_, v_, steps_;
  std::map<std::string, StepMemory> sparse_in_common_;
};

}  // namespace cloam
