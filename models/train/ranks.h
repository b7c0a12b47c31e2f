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
  /// False: the others are only pretended, and nothing that is theirs comes of a trade.
  virtual bool real() const { return true; }
  /// Whether they may have memory in common where they run on one host.
  virtual bool may_share_memory() const { return true; }
  /// Returns once every rank is here, however long that takes.
  virtual void await_all() const;
  /// The same after work of which each has its own, in pieces. Fault::device, naming the rank, where one has finished
  /// no piece for too long.
  virtual void await_work() const { await_all(); }
  /// A piece of such work is done.
  virtual void finish_piece() const {}
};

/// One rank, which needs no others.
const Ranks& alone();

/// What every rank gave, by rank, for all of them.
std::vector<std::string> gathered(const Ranks& ranks, const std::string& mine);
/// What the first rank gave; as many numbers on all.
std::vector<int64_t> from_first(const Ranks& ranks, std::vector<int64_t> mine);
/// Returns once every rank is here.
void meet(const Ranks& ranks);

/// A sum over shares of weight times values, of which each rank adds one at a time, in the order of the ranks. One
/// addition at a time in one order: a single rank that adds all shares gets the same bits. Values lie in rows, of which
/// each rank adds up its Share. Its memory stays from one sum to the next.
class OrderedSum {
 public:
  explicit OrderedSum(const Ranks& ranks) : ranks_(&ranks) {}
  /// A new sum, of nothing.
  void begin() { added_ = false; }
  /// A share's values, in rows: this rank's, those before and those behind.
  struct Rows {
    std::span<const float> before, own, behind;
  };
  /// Of every rank a share, as many rows on all; weights: of all ranks' shares. The same number of rows until begin().
  void add(std::span<const float> values, int64_t rows, const std::vector<float>& weights);
  /// The same for the last share of a sum: this rank's rows of all of it go to `sum`, which may be where the share's
  /// own rows lie. spread() has none of it.
  void add_last(const Rows& share, std::span<float> sum, int64_t rows, const std::vector<float>& weights);
  /// The same where ranks see each other's shares: `shares` are this rank's rows of each, by rank.
  void add_last(const std::vector<std::span<const float>>& shares, std::span<float> sum,
                const std::vector<float>& weights);
  /// All rows, on all ranks, into `all`.
  void spread(std::span<float> all) const;

 private:
  std::span<const float> of_rank(int64_t rank, const Rows& rows) const;
  void add_to(std::span<float> sum, const Rows& share, const std::vector<float>& weights);

  const Ranks* ranks_;
  std::vector<float> sum_;
  std::vector<float> received_;  // own rows of the other ranks' shares
  int64_t rows_ = 0;
  bool added_ = false;
};

/// Each rank's `own` rows, of rows of so many bytes, go to all others, whose rows lie before them and behind them.
struct SpreadRows {
  std::span<const std::byte> own;
  std::span<std::byte> before, behind;
};
void spread_rows(const Ranks& ranks, const SpreadRows& rows, int64_t count);

}  // namespace cloam
