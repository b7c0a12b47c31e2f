// See ranks.h.
#include "models/train/ranks.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace cloam {
namespace {

using Sent = std::vector<std::span<const std::byte>>;
using Received = std::vector<std::span<std::byte>>;

class Alone final : public Ranks {
 public:
  int64_t rank() const override { return 0; }
  int64_t size() const override { return 1; }
  void trade(const Sent&, const Received&) const override {}
};

/// Each rank gets `mine`, and gives as much as `all` has room for.
void trade_texts(const Ranks& ranks, const std::string& mine, std::vector<std::string>& all) {
  Received from;
  for (std::string& other : all) from.push_back(std::as_writable_bytes(std::span(other)));
  ranks.trade(Sent(all.size(), std::as_bytes(std::span(mine))), from);
  all[static_cast<size_t>(ranks.rank())] = mine;
}

std::string as_text(uint64_t number) {
  std::string out(sizeof number, '\0');
  std::memcpy(out.data(), &number, sizeof number);
  return out;
}

size_t size_in(const std::string& written) {
  uint64_t number = 0;
  std::memcpy(&number, written.data(), sizeof number);
  return number;
}

Share share_of(const Ranks& ranks, int64_t rank) { return {rank, ranks.size()}; }

/// A rank's rows of `count` rows that lie in `values`.
template <class Value>
std::span<Value> rows_of(std::span<Value> values, int64_t count, const Share& share) {
  const size_t width = count == 0 ? 0 : values.size() / static_cast<size_t>(count);
  return values.subspan(static_cast<size_t>(share.begin(count)) * width,
                        static_cast<size_t>(share.size(count)) * width);
}

struct WeightedShares {
  std::span<const float> before;  // added to; empty: to nothing
  const std::vector<std::span<const float>>& shares;
  const std::vector<float>& weights;
};

/// to[begin + i] = before + the shares, one after the other. So few floats lie in registers meanwhile: each value is
/// read once and written once.
template <size_t count>
void add_block(std::span<float> to, size_t begin, const WeightedShares& of) {
  std::array<float, count> sum{};  // from 0, of which no share's -0 is left
  if (!of.before.empty()) std::copy_n(&of.before[begin], count, sum.begin());
  for (size_t share = 0; share < of.shares.size(); ++share) {
    const float weight = of.weights[share];
    const float* const values = of.shares[share].data() + begin;
    for (size_t i = 0; i < count; ++i) sum[i] += weight * values[i];
  }
  std::copy_n(sum.begin(), count, &to[begin]);
}

/// `to` may be one of the shares, or what they are added to.
void add_weighted(std::span<float> to, const WeightedShares& of) {
  constexpr size_t kBlock = 16;
  size_t begin = 0;
  for (; begin + kBlock <= to.size(); begin += kBlock) add_block<kBlock>(to, begin, of);
  for (; begin < to.size(); ++begin) add_block<1>(to, begin, of);
}

}  // namespace

void Ranks::await_all() const { meet(*this); }

const Ranks& alone() {
  static const Alone one;
  return one;
}

std::vector<std::string> gathered(const Ranks& ranks, const std::string& mine) {
  const auto count = static_cast<size_t>(ranks.size());
  std::vector<std::string> sizes(count, std::string(sizeof(uint64_t), '\0')), all(count);
  trade_texts(ranks, as_text(mine.size()), sizes);
  for (size_t rank = 0; rank < count; ++rank) all[rank].resize(size_in(sizes[rank]));
  trade_texts(ranks, mine, all);
  return all;
}

void meet(const Ranks& ranks) {
  std::vector<std::string> bytes(static_cast<size_t>(ranks.size()), " ");
  trade_texts(ranks, " ", bytes);
}

std::vector<int64_t> from_first(const Ranks& ranks, std::vector<int64_t> mine) {
  const auto count = static_cast<size_t>(ranks.size());
  const bool first = ranks.rank() == 0;
  Sent to(count);
  Received from(count);
  if (first) std::fill(to.begin(), to.end(), std::as_bytes(std::span(mine)));
  if (!first) from.front() = std::as_writable_bytes(std::span(mine));
  ranks.trade(to, from);
  return mine;
}

std::span<const float> OrderedSum::of_rank(int64_t rank, const Rows& rows) const {
  const Share own = share_of(*ranks_, ranks_->rank()), share = share_of(*ranks_, rank);
  if (rank == own.rank) return rows.own;
  const size_t values = rows.before.size() + rows.own.size() + rows.behind.size();
  const size_t width = rows_ == 0 ? 0 : values / static_cast<size_t>(rows_);
  const bool before = rank < own.rank;
  const int64_t begin = share.begin(rows_) - (before ? 0 : own.end(rows_));
  return (before ? rows.before : rows.behind)
      .subspan(static_cast<size_t>(begin) * width, static_cast<size_t>(share.size(rows_)) * width);
}

void OrderedSum::add_to(std::span<float> sum, const Rows& share, const std::vector<float>& weights) {
  received_.resize(static_cast<size_t>(ranks_->size() - 1) * sum.size());
  std::vector<std::span<const float>> shares;
  Sent to;
  Received from;
  for (int64_t rank = 0; rank < ranks_->size(); ++rank) {
    const bool own = rank == ranks_->rank();
    const auto place = static_cast<size_t>(rank - (rank > ranks_->rank() ? 1 : 0)) * sum.size();
    const std::span<float> other = own ? std::span<float>() : std::span(received_).subspan(place, sum.size());
    shares.push_back(own ? share.own : std::span<const float>(other));
    to.push_back(std::as_bytes(of_rank(rank, share)));
    from.push_back(std::as_writable_bytes(other));
  }
  ranks_->trade(to, from);
  add_last(shares, sum, weights);
}

void OrderedSum::add_last(const std::vector<std::span<const float>>& shares, std::span<float> sum,
                          const std::vector<float>& weights) {
  add_weighted(sum, {added_ ? std::span<const float>(sum_) : std::span<const float>(), shares, weights});
  added_ = true;
}

void OrderedSum::add(std::span<const float> values, int64_t rows, const std::vector<float>& weights) {
  rows_ = rows;
  const std::span<const float> own = rows_of(values, rows, share_of(*ranks_, ranks_->rank()));
  const auto begin = static_cast<size_t>(own.data() - values.data());
  sum_.resize(own.size());
  add_to(sum_, {values.first(begin), own, values.subspan(begin + own.size())}, weights);
}

void OrderedSum::add_last(const Rows& share, std::span<float> sum, int64_t rows, const std::vector<float>& weights) {
  rows_ = rows;
  add_to(sum, share, weights);
}

void OrderedSum::spread(std::span<float> all) const {
  const Share share = share_of(*ranks_, ranks_->rank());
  const std::span<float> place = rows_of(all, rows_, share);
  std::ranges::copy(sum_, place.begin());
  const size_t begin = static_cast<size_t>(place.data() - all.data());
  spread_rows(*ranks_,
              {std::as_bytes(std::span(sum_)), std::as_writable_bytes(all.first(begin)),
               std::as_writable_bytes(all.subspan(begin + place.size()))},
              rows_);
}

void spread_rows(const Ranks& ranks, const SpreadRows& rows, int64_t count) {
  const Share own = share_of(ranks, ranks.rank());
  const size_t all = rows.own.size() + rows.before.size() + rows.behind.size();
  const size_t width = count == 0 ? 0 : all / static_cast<size_t>(count);
  Sent to(static_cast<size_t>(ranks.size()), rows.own);
  Received from;
  for (int64_t rank = 0; rank < ranks.size(); ++rank) {
    const Share share = share_of(ranks, rank);
    const size_t begin = static_cast<size_t>(share.begin(count)) * width;
    const size_t size = static_cast<size_t>(share.size(count)) * width;
    const size_t own_end = static_cast<size_t>(own.end(count)) * width;
    if (rank < own.rank)
      from.push_back(rows.before.subspan(begin, size));
    else if (rank > own.rank)
      from.push_back(rows.behind.subspan(begin - own_end, size));
    else
      from.emplace_back();
  }
  ranks.trade(to, from);
}

}  // namespace cloam
