// See moments.h.
#include "models/data/moments.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "runtime/error.h"

namespace cloam {

Moments::Moments(std::vector<double> times)
    : times_(std::move(times)), usual_gap_(std::numeric_limits<double>::infinity()) {
  std::sort(times_.begin(), times_.end());
  times_.erase(std::unique(times_.begin(), times_.end()), times_.end());
  std::vector<double> gaps;
  for (std::size_t i = 1; i < times_.size(); ++i) gaps.push_back(times_[i] - times_[i - 1]);
  if (gaps.empty()) return;
  std::nth_element(gaps.begin(), gaps.begin() + std::ptrdiff_t(gaps.size() / 2), gaps.end());
  usual_gap_ = gaps[gaps.size() / 2];
}

int Moments::nearest(double time) const {
  const auto after = std::lower_bound(times_.begin(), times_.end(), time);
  if (after == times_.begin()) return 0;
  const bool earlier = after == times_.end() || time - *std::prev(after) <= *after - time;
  return int(after - times_.begin()) - earlier;
}

double Moments::distance(double time) const { return std::abs(times_[std::size_t(nearest(time))] - time); }

std::string Moments::range() const { return text("from ", times_.front(), " to ", times_.back(), " s"); }

std::vector<Frame> nearest_frames(const std::vector<Frame>& frames, const Moments& moments) {
  std::map<std::pair<std::string, int>, std::size_t> nearest;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const double time = *frames[i].timestamp;
    if (!moments.near(time)) continue;
    const auto [found, first] = nearest.emplace(std::pair(frames[i].sensor, moments.nearest(time)), i);
    if (moments.distance(time) < moments.distance(*frames[found->second].timestamp)) found->second = i;
  }
  std::map<std::size_t, int> kept;  // in the order given
  for (const auto& [place, index] : nearest) kept.emplace(index, place.second);
  std::vector<Frame> out;
  for (const auto& [index, step] : kept) {
    out.push_back(frames[index]);
    out.back().step = step;
  }
  return out;
}

}  // namespace cloam
