// See proposals.h.
#include "models/render/proposals.h"

#include <cmath>

namespace cloam {
namespace {

// P(x) = |l - 1| / l ((x / |l - 1| + 1)^l - 1) of twice the distance, l = -1.5.
constexpr float kPower = -1.5f, kPlace = 2.5f, kFactor = 2.f;
constexpr float kLeastWeight = 1e-5f;  // of a piece: none is never sampled

Tensor bent(const Tensor& t) {
  return (pow(maximum(t, 0.f) * (kFactor / kPlace) + 1.f, kPower) - 1.f) * (kPlace / kPower);
}

Tensor unbent(const Tensor& y) {
  return (pow(maximum(y * (kPower / kPlace) + 1.f, 1e-9f), 1 / kPower) - 1.f) * (kPlace / kFactor);
}

Tensor before(const Tensor& edges) { return slice(edges, 1, 0, edges.dim(1) - 1); }
Tensor after(const Tensor& edges) { return slice(edges, 1, 1, edges.dim(1)); }
Tensor lengths_of(const Tensor& edges) { return after(edges) - before(edges); }

}  // namespace

RayWarp::RayWarp(const Tensor& span, bool power) : power_(power) {
  const Tensor near = slice(span, 1, 0, 1), far = maximum(slice(span, 1, 1, 2), near + 1e-3f);
  near_ = power ? bent(near) : near;
  far_ = power ? bent(far) : far;
}

Tensor RayWarp::distances(const Tensor& normalised) const {
  const Tensor even = near_ + (far_ - near_) * normalised;
  return power_ ? unbent(even) : even;
}

Tensor RayWarp::normalised(const Tensor& distances) const {
  return ((power_ ? bent(distances) : distances) - near_) / (far_ - near_);
}

/// The inverse of a CDF that is straight within each piece: t(u) = first edge + sum of lengths, each times the share of
/// its piece that lies below u.
Tensor resampled_edges(const RayHistogram& histogram, const Tensor& ranks) {
  const Tensor weights = stop_gradient(histogram.weights) + kLeastWeight;
  const Tensor share = weights / sum(weights, {{1}, true}), below = cumsum(share, 1, {.exclusive = true});
  const Tensor lengths = lengths_of(histogram.edges);
  const Tensor inside = clamp((unsqueeze(ranks, 2) - unsqueeze(below, 1)) / unsqueeze(share, 1), 0.f, 1.f);
  const Tensor t = slice(histogram.edges, 1, 0, 1) + sum(unsqueeze(lengths, 1) * inside, {{2}});
  const int64_t count = t.dim(1);
  const Tensor middle = (before(t) + after(t)) * 0.5f;
  const Tensor first = 2.f * slice(t, 1, 0, 1) - slice(middle, 1, 0, 1);
  const Tensor last = 2.f * slice(t, 1, count - 1, count) - slice(middle, 1, count - 2, count - 1);
  return clamp(concat({first, middle, last}, 1), 0.f, 1.f);
}

/// A piece of mass w over [c, e], convolved with a box of half width h, has below p the mass w times the mean of
/// K(u) = clamp((u + h) / 2h, 0, 1) over u from p - e to p - c. That is the CDF of the paper's piecewise linear
/// histogram, without sorting its edges.
Tensor blurred_masses(const RayHistogram& histogram, const Tensor& at, float half) {
  const auto grid = [&](const Tensor& edge) { return (unsqueeze(at, 2) - unsqueeze(edge, 1)) * (0.5f / half) + 0.5f; };
  const Tensor low = grid(after(histogram.edges)), high = grid(before(histogram.edges));
  const Tensor width = unsqueeze(maximum(lengths_of(histogram.edges), 1e-7f) * (0.5f / half), 1);
  const Tensor inner_low = clamp(low, 0.f, 1.f), inner_high = clamp(high, 0.f, 1.f);
  const Tensor rising = (inner_high - inner_low) * (inner_high + inner_low) * 0.5f;
  const Tensor full_part = maximum(high - maximum(low, 1.f), 0.f);
  const Tensor share = minimum((rising + full_part) / width, 1.f);
  const Tensor cdf = sum(unsqueeze(stop_gradient(histogram.weights), 1) * share, {{2}});
  return stop_gradient(maximum(lengths_of(cdf), 0.f));
}

Tensor interlevel_loss(const RayHistogram& truth, const RayHistogram& proposal, float half) {
  const Tensor wanted = blurred_masses(truth, proposal.edges, half);
  return mean(square(maximum(wanted - proposal.weights, 0.f)) / (proposal.weights + 1e-5f));
}

/// The double sum by running ones: 2 sum over i of w_i (m_i sum of w_j before - sum of w_j m_j before).
Tensor distortion_loss(const RayHistogram& histogram) {
  const Tensor& w = histogram.weights;
  const Tensor middle = (before(histogram.edges) + after(histogram.edges)) * 0.5f;
  const Tensor mass = cumsum(w, 1, {.exclusive = true}), moment = cumsum(w * middle, 1, {.exclusive = true});
  const Tensor between = 2.f * w * (middle * mass - moment), within = square(w) * lengths_of(histogram.edges);
  return mean(sum(between + within * (1.f / 3.f), {{1}}));
}

}  // namespace cloam
