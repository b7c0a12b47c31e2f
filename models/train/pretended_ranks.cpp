// See pretended_ranks.h.
#include "models/train/pretended_ranks.h"

#include <algorithm>

namespace cloam {

void PretendedRanks::trade(const std::vector<std::span<const std::byte>>& to,
                           const std::vector<std::span<std::byte>>& from) const {
  for (size_t rank = 1; rank < to.size(); ++rank) {
    sent_ += to[rank].size();
    std::copy_n(to[rank].begin(), std::min(to[rank].size(), from[rank].size()), from[rank].begin());
  }
}

}  // namespace cloam
