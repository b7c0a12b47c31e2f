// The first of several ranks whose others are not there: what a step costs each of them, before there are any.
#pragma once
#include "models/train/ranks.h"

namespace cloam {

/// All others say and send what this one does. Counts the bytes that a rank sends; it receives as many.
class PretendedRanks final : public Ranks {
 public:
  explicit PretendedRanks(int64_t size) : size_(size) {}
  int64_t rank() const override { return 0; }
  int64_t size() const override { return size_; }
  bool real() const override { return false; }
  void trade(const std::vector<std::span<const std::byte>>& to,
             const std::vector<std::span<std::byte>>& from) const override;
  uint64_t sent_bytes() const { return sent_; }

 private:
  int64_t size_;
  mutable uint64_t sent_ = 0;
};

}  // namespace cloam
