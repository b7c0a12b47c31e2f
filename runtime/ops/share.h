// Private: how a loop over equal pieces of work is shared out among work-items, for kernels written with the prelude's
// LOOP_LO, LOOP_HI and LOOP_STEP.
#pragma once
#include <algorithm>

#include "runtime/cl.h"

namespace cloam {

struct WorkShare {
  int64_t chunk = 1;  // pieces a work-item, on CPU devices
  Range range;
};

/// CPU devices: about 64 work-items, none below `least` pieces. GPU devices: a lane a piece, up to a million lanes.
inline WorkShare share(int64_t pieces, int64_t least) {
  if (!is_cpu_class()) return {1, range1(std::min<int64_t>(pieces, 1 << 20), 64)};
  const int64_t chunk = std::max({int64_t{1}, least, (pieces + 63) / 64});
  return {chunk, range1((pieces + chunk - 1) / chunk)};
}

/// Numbers in a row of a tensor whose rows are its first axis.
inline int64_t row_width(const Shape& shape) {
  int64_t width = 1;
  for (int i = 1; i < shape.rank(); i++) width *= shape[i];
  return width;
}

/// Pieces of work on rows: a row each on CPU devices, a number each on GPU devices.
inline int64_t row_pieces(int64_t rows, int64_t width) { return is_cpu_class() ? rows : rows * width; }

}  // namespace cloam
