// Which part of each batch is whose, where several processes train one model.
#pragma once
#include <cstdint>

namespace cloam {

constexpr int64_t kMostShares = 4096;

/// All ranks draw the same batch, by its seed and step, and keep rows begin(count) to end(count) of it each.
struct Share {
  int64_t rank = 0, ranks = 1;
  int64_t begin(int64_t count) const { return count * rank / ranks; }
  int64_t end(int64_t count) const { return count * (rank + 1) / ranks; }
  int64_t size(int64_t count) const { return end(count) - begin(count); }
  bool holds(int64_t row, int64_t count) const { return row >= begin(count) && row < end(count); }
};

}  // namespace cloam
