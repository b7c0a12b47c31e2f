// Processes that work together, each on a device of its own: what they tell each other, and sums of floats that are the
// same bits however many they are.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "models/io/share.h"

namespace cloam {

class Ranks {
 public:
  virtual ~Ranks() = default;
  virtual int64_t rank() const = 0;  // 0 is the first
  virtual int64_t size() const = 0;
  /// Sends each rank its bytes of `to` and fills those of `from`, both by rank, as long as what the other sends; the
  /// own places are not looked at. Every rank calls it, in one order of calls. Fault::device, naming the rank, where
  /// one is gone or silent for too long.
  virtual void trade(const std::vector<std::span<const std::byte>>& to,
                     const std::vector<std::span<std::byte>>& from) const = 0;
  /// Returns once every rank is here, however long that takes: for work of which each has its own.
  virtual void await_all() const;
};

/// One rank, which needs no others.
const Ranks& alone();

/// What every rank gave, by rank, for all of them.
std::vector<std::string> gathered(const Ranks& ranks, const std::string& mine);
/// What the first rank gave; as many numbers on all.
std::vector<int64_t> from_first(const Ranks& ranks, std::vector<int64_t> mine);
/// Returns once every rank is here.
inline void meet(const Ranks& ranks) { gathered(ranks, ""); }

/// A sum over shares of weight times values, of which each rank adds one at a time, in the order of the ranks. One
/// addition at a time in one order: a single rank that adds all shares gets the same bits. Its memory stays from one
/// sum to the next.
class OrderedSum {
 public:
  explicit OrderedSum(const Ranks& ranks) : ranks_(ranks) {}
  /// A new sum, of no values.
  void begin() { added_ = false; }
  /// Makes the sum one of `count` values, no fewer than were added before, which it keeps.
  void grow(size_t count);
  /// This rank's share, all of it to be filled before each add(); the whole, on all ranks, after take().
  std::span<float> values() { return values_; }
  /// Weights: of all ranks' shares.
  void add(const std::vector<float>& weights);
  void take();

 private:
  const Ranks& ranks_;
  std::vector<float> values_;
  std::vector<float> sum_;       // of the values that are this rank's to add (Share)
  std::vector<float> received_;  // their shares of the other ranks
  bool added_ = false;
};

}  // namespace cloam
