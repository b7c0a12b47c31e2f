// A step on a whole image whose graph would not fit in memory, tile by tile: maps of the image on the host, tiles of
// them that are worked on alone, and sums of the gradients of all tiles.
#pragma once
#include <vector>

#include "runtime/tensor.h"

namespace cloam {

/// A map [rows,columns,channels].
struct HostMap {
  int64_t rows = 0, columns = 0, channels = 0;
  std::vector<float> values = {};
};

/// A part of a map, in its cells.
struct Tile {
  int64_t x, y, columns, rows;
};

/// The map in tiles of side x side, those at the right and lower edge cut.
std::vector<Tile> tiles_of(const HostMap& map, int64_t side);
/// The tile and `halo` cells around it, as far as they lie in the map.
Tile widened(const Tile& tile, int64_t halo, const HostMap& map);
/// As a parameter [1,rows,columns,channels].
Tensor cut(const HostMap& map, const Tile& tile);
/// Adds the values of a tile [rows,columns,channels].
void add_to(HostMap& map, const Tile& tile, const std::vector<float>& part);
/// Pixels [N,C,H,W] of a tile; `scale` of them a cell and side.
Tensor cropped(const Tensor& image, const Tile& tile, int scale);

/// Sums of the gradients by `wanted` over tiles. Each tile is evaluated at once, so that its graph is gone before the
/// next.
class GradientSums {
 public:
  explicit GradientSums(const Tensors& wanted) : wanted_(wanted), sums_(wanted.size()) {}
  /// Returns the gradients by `also` and the values of `more`, evaluated.
  Tensors add(const Tensor& loss, const Tensors& also = {}, const Tensors& more = {});
  /// An empty handle where no tile's loss depends on one.
  const Tensors& sums() const { return sums_; }

 private:
  Tensors wanted_, sums_;
};

}  // namespace cloam
