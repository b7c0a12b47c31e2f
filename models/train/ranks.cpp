// See ranks.h.
#include "models/train/ranks.h"

#include <algorithm>
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

template <class Float>
auto part_of(std::span<Float> values, const Share& share) {
  const auto count = static_cast<int64_t>(values.size());
  return values.subspan(static_cast<size_t>(share.begin(count)), static_cast<size_t>(share.size(count)));
}

/// As added to zeros, which no share's -0 is left of.
void begin_weighted(std::span<float> sum, std::span<const float> values, float weight) {
  for (size_t i = 0; i < sum.size(); ++i) sum[i] = 0.f + weight * values[i];
}

void add_weighted(std::span<float> sum, std::span<const float> values, float weight) {
  for (size_t i = 0; i < sum.size(); ++i) sum[i] += weight * values[i];
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

void OrderedSum::grow(size_t count) {
  if (added_ && count == values_.size()) return;
  if (added_) take();  // other values will be this rank's to add
  values_.resize(count);
  const std::span<const float> own = part_of(std::span<const float>(values_), share_of(ranks_, ranks_.rank()));
  sum_.resize(own.size());
  if (added_) std::ranges::copy(own, sum_.begin());
}

void OrderedSum::add(const std::vector<float>& weights) {
  const auto others = static_cast<size_t>(ranks_.size() - 1);
  received_.resize(others * sum_.size());
  std::vector<std::span<const float>> shares;
  Sent to;
  Received from;
  for (int64_t rank = 0; rank < ranks_.size(); ++rank) {
    const std::span<float> of_mine = part_of(std::span(values_), share_of(ranks_, rank));
    const bool own = rank == ranks_.rank();
    const auto place = static_cast<size_t>(rank - (rank > ranks_.rank() ? 1 : 0)) * sum_.size();
    const std::span<float> other = own ? std::span<float>() : std::span(received_).subspan(place, sum_.size());
    shares.emplace_back(own ? of_mine : other);
    to.push_back(std::as_bytes(of_mine));
    from.push_back(std::as_writable_bytes(other));
  }
  ranks_.trade(to, from);
  for (size_t rank = 0; rank < shares.size(); ++rank) {
    if (added_)
      add_weighted(sum_, shares[rank], weights[rank]);
    else
      begin_weighted(sum_, shares[rank], weights[rank]);
    added_ = true;
  }
}

void OrderedSum::take() {
  Sent to;
  Received from;
  for (int64_t rank = 0; rank < ranks_.size(); ++rank) {
    to.push_back(std::as_bytes(std::span<const float>(sum_)));
    from.push_back(std::as_writable_bytes(part_of(std::span(values_), share_of(ranks_, rank))));
  }
  ranks_.trade(to, from);
  std::ranges::copy(sum_, part_of(std::span(values_), share_of(ranks_, ranks_.rank())).begin());
}

}  // namespace cloam
