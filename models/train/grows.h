// Capability: the rows of its parameters become more, fewer or others while it trains.
#pragma once
#include "models/train/parameter_groups.h"
#include "models/train/takes_shapes.h"

namespace cloam {

/// Row i (of the first axis) of the parameter `name` was row source[i]; -1: it is new, and so is its optimiser state.
struct RowMove {
  std::string name;
  std::vector<int32_t> source;
};
using RowMoves = std::vector<RowMove>;

class Grows : public TakesShapes {
 public:
  /// After each step: what was moved, so that the optimiser's state follows.
  virtual RowMoves grow(const Progress& progress) = 0;
  /// The last step after which there may be more parameters, of a training that stands like this.
  virtual int64_t grows_until(const Progress& progress) const = 0;
};

}  // namespace cloam
