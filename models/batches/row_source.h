// Batches of rows of a set that lies in memory: codes, images of a set.
#pragma once
#include <vector>

#include "models/io/host_random.h"
#include "models/io/share.h"

namespace cloam {

struct RowBatch {
  std::vector<int32_t> rows;
  std::vector<float> chances;  // a number in [0,1) with each, for what the method decides row by row
};

/// `count` of these rows at random, any of them as often as it comes.
inline RowBatch draw_rows(const std::vector<int32_t>& from, int64_t count, HostRandom random, const Share& share) {
  RowBatch out;
  for (int64_t i = 0; i < count; ++i) {
    const int32_t row = from[random.below(from.size())];
    const float chance = random.uniform();
    if (!share.holds(i, count)) continue;
    out.rows.push_back(row);
    out.chances.push_back(chance);
  }
  return out;
}

}  // namespace cloam
