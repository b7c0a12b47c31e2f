// Adaptive density control (Kerbl et al. 2023, section 5) and relocation (Kheradmand et al. 2024).
#include "models/splat/growth.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "runtime/error.h"
#include "runtime/ops/splat.h"

namespace cloam {
namespace {

constexpr double kSplitFactor = 1.6;  // of deviations, when one becomes two
constexpr float kResetOpacity = 0.01f;
constexpr int kMaxShared = 51;        // copies of one gaussian: the binomials stay exact
constexpr double kMcmcGrowth = 0.05;  // of the gaussians, a time
// The papers' last steps, of 30,000, and their shares of shorter horizons.
constexpr int64_t kDensifyUntil = 15000, kMcmcUntil = 25000;
constexpr double kDensifyShare = 0.5, kMcmcShare = 0.83;
enum Stream : uint32_t { kSplitStream = 40, kRelocateStream = 41, kNoiseStream = 42 };

double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }
double logit(double p) { return std::log(p / (1 - p)); }

/// The logit that two gaussians in one place need to cover what one did: 1 - (1 - a)^2 = opacity (Rota Bulo et al.
/// 2024). With the whole opacity each, pictures lose several decibels at every growth.
float opacity_of_two(float of_one) {
  return static_cast<float>(logit(std::max(1e-6, 1 - std::sqrt(1 - std::min(sigmoid(double{of_one}), 1 - 1e-6)))));
}

bool in_schedule(const GrowthOptions& options, const Progress& progress, int64_t until) {
  return progress.step > options.from && progress.step <= until && progress.step % options.every == 0;
}

/// `most`, or that share of the horizon if it comes first.
int64_t last_step(const Progress& progress, int64_t most, double share) {
  if (progress.horizon == 0) return most;
  return std::min(most, static_cast<int64_t>(share * static_cast<double>(progress.horizon)));
}

/// Row `row` of every array at the end of `to`.
void append(Gaussians& to, const Gaussians& from, size_t row) {
  for (const auto& [name, values, width] : kGaussianArrays) {
    const auto begin = (from.*values).begin() + static_cast<std::ptrdiff_t>(row * width);
    (to.*values).insert((to.*values).end(), begin, begin + static_cast<std::ptrdiff_t>(width));
  }
}

Gaussians none_like(const Gaussians& like) {
  Gaussians out;
  out.up = like.up;
  out.metric = like.metric;
  return out;
}

double largest(const Gaussians& g, size_t row) {
  return std::exp(double{*std::max_element(&g.scales[3 * row], &g.scales[3 * row] + 3)});
}

Eigen::Matrix3d rotation(const Gaussians& g, size_t row) {
  const float* q = &g.rotations[4 * row];
  return Eigen::Quaterniond(double{q[0]}, double{q[1]}, double{q[2]}, double{q[3]}).normalized().toRotationMatrix();
}

class Densify final : public Growth {
 public:
  Densify(const GrowthOptions& options, const CameraRegion& cameras) : options_(options), cameras_(cameras) {}
  bool due(const Progress& progress) const override { return in_schedule(options_, progress, until(progress)); }
  int64_t until(const Progress& progress) const override { return last_step(progress, kDensifyUntil, kDensifyShare); }

  GrowthMoves grow(Gaussians& g, const GrowthStatistics& statistics, const Progress& progress) override {
    const float limit = limit_for(statistics, g.count());
    Gaussians out = none_like(g);
    GrowthMoves moves;
    std::vector<size_t> doubled;
    for (size_t i = 0; i < g.count(); i++) {
      const bool wanted = statistics.gradients[i] >= limit, split = wanted && halves_of(g, i) == 2;
      if (gone(g, i, progress)) continue;
      if (wanted) doubled.push_back(i);
      if (split) continue;
      append(out, g, i);
      if (wanted) out.opacities.back() = opacity_of_two(g.opacities[i]);
      moves.source.push_back(static_cast<int32_t>(i));
    }
    moves.parent = moves.source;
    for (const size_t i : doubled) moves.parent.insert(moves.parent.end(), halves_of(g, i), static_cast<int32_t>(i));
    add(out, g, doubled, progress);
    moves.source.resize(out.count(), -1);
    g = std::move(out);
    moves.opacities_reset = progress.step % options_.reset_every == 0;
    if (moves.opacities_reset)
      for (float& o : g.opacities) o = std::min(o, static_cast<float>(logit(double{kResetOpacity})));
    return moves;
  }

 private:
  bool gone(const Gaussians& g, size_t i, const Progress& progress) const {
    if (sigmoid(double{g.opacities[i]}) < double{options_.faint}) return true;
    const Eigen::Vector3d place(double{g.means[3 * i]}, double{g.means[3 * i + 1]}, double{g.means[3 * i + 2]});
    const double unit = std::max(cameras_.radius, (place - cameras_.middle).norm());
    return progress.step > options_.reset_every && largest(g, i) > options_.large * unit;
  }

  /// How many are added for one that is doubled: a small one stays besides.
  size_t halves_of(const Gaussians& g, size_t i) const {
    return largest(g, i) > options_.small * cameras_.radius ? 2 : 1;
  }

  /// The gradient from which on there is room for one more each.
  float limit_for(const GrowthStatistics& statistics, size_t count) const {
    const auto room = static_cast<size_t>(std::max<int64_t>(0, options_.max_count - static_cast<int64_t>(count)));
    std::vector<float> over;
    for (const float x : statistics.gradients)
      if (x >= options_.gradient) over.push_back(x);
    if (over.size() <= room) return options_.gradient;
    if (room == 0) return std::numeric_limits<float>::infinity();
    std::nth_element(over.begin(), over.begin() + static_cast<std::ptrdiff_t>(room), over.end(), std::greater<>());
    return std::nextafter(over[room], std::numeric_limits<float>::infinity());
  }

  /// Two smaller ones drawn from each large one, one more of each small one in its place.
  void add(Gaussians& out, const Gaussians& g, const std::vector<size_t>& doubled, const Progress& progress) const {
    const std::vector<float> noise = random_normal({static_cast<int64_t>(doubled.size()), 6},
                                                   {progress.seed, static_cast<uint32_t>(progress.step), kSplitStream})
                                         .to_host();
    for (size_t k = 0; k < doubled.size(); k++) {
      const size_t i = doubled[k];
      if (halves_of(g, i) == 1) {
        append(out, g, i);
        out.opacities.back() = opacity_of_two(g.opacities[i]);
        continue;
      }
      for (size_t half = 0; half < 2; half++) {
        append(out, g, i);
        const size_t row = out.count() - 1;
        Eigen::Vector3d away;
        for (int axis = 0; axis < 3; axis++) {
          float& scale = out.scales[3 * row + static_cast<size_t>(axis)];
          away[axis] = double{noise[6 * k + 3 * half + static_cast<size_t>(axis)]} * std::exp(double{scale});
          scale -= static_cast<float>(std::log(kSplitFactor));
        }
        const Eigen::Vector3d moved = rotation(g, i) * away;
        for (int axis = 0; axis < 3; axis++)
          out.means[3 * row + static_cast<size_t>(axis)] += static_cast<float>(moved[axis]);
      }
    }
  }

  GrowthOptions options_;
  CameraRegion cameras_;
};

class Mcmc final : public Growth {
 public:
  explicit Mcmc(const GrowthOptions& options) : options_(options) {}
  bool due(const Progress& progress) const override { return in_schedule(options_, progress, until(progress)); }
  int64_t until(const Progress& progress) const override { return last_step(progress, kMcmcUntil, kMcmcShare); }

  /// Faint gaussians become copies of others, chosen by opacity; then a few more are added the same way.
  GrowthMoves grow(Gaussians& g, const GrowthStatistics&, const Progress& progress) override {
    const size_t count = g.count();
    std::vector<size_t> faint;
    std::vector<double> upto(count);  // running sum of the opacities to choose by
    double sum = 0;
    for (size_t i = 0; i < count; i++) {
      const double opacity = sigmoid(double{g.opacities[i]});
      if (opacity <= double{options_.faint})
        faint.push_back(i);
      else
        sum += opacity;
      upto[i] = sum;
    }
    const size_t wanted = std::min(static_cast<size_t>(options_.max_count),
                                   static_cast<size_t>(static_cast<double>(count) * (1 + kMcmcGrowth)));
    const size_t added = wanted > count ? wanted - count : 0, all = faint.size() + added;
    GrowthMoves moves;
    if (all == 0 || sum <= 0) return moves;
    const std::vector<float> uniform =
        random_uniform({static_cast<int64_t>(all)},
                       {progress.seed, static_cast<uint32_t>(progress.step), kRelocateStream})
            .to_host();
    std::vector<int> copies(count, 1);
    std::vector<size_t> chosen;
    for (const float u : uniform) {
      const auto at = std::upper_bound(upto.begin(), upto.end(), double{u} * sum) - upto.begin();
      chosen.push_back(std::min(static_cast<size_t>(at), count - 1));
      copies[chosen.back()] = std::min(copies[chosen.back()] + 1, kMaxShared);
    }
    moves.source.resize(count + added, -1);
    moves.parent.resize(count + added);
    std::iota(moves.parent.begin(), moves.parent.end(), 0);
    for (size_t i = 0; i < count; i++)
      if (copies[i] == 1) moves.source[i] = static_cast<int32_t>(i);
    for (size_t i = 0; i < count; i++)
      if (copies[i] > 1) share(g, i, copies[i]);
    for (size_t k = 0; k < all; k++) {
      const size_t to = k < faint.size() ? faint[k] : count + k - faint.size();
      place(g, chosen[k], to);
      moves.parent[to] = static_cast<int32_t>(chosen[k]);
    }
    for (const size_t i : faint) moves.source[i] = -1;
    return moves;
  }

  Tensor penalty(const Cloud& cloud) const override {
    return options_.weight_opacity * mean(sigmoid(cloud.opacities)) + options_.weight_scale * mean(exp(cloud.scales));
  }

  /// Noise with each gaussian's covariance, for those that are nearly transparent (eq. 8).
  Tensor shift(const Cloud& cloud, const Progress& progress, float rate) const override {
    const int64_t count = cloud.means.dim(0);
    const Tensor amount = unsqueeze(sigmoid(100.f * (0.005f - sigmoid(cloud.opacities))) * (rate * options_.noise), 1);
    const Tensor normal =
        random_normal({count, 3}, {progress.seed, static_cast<uint32_t>(progress.step), kNoiseStream});
    return covariance_times(cloud, normal * amount);
  }

 private:
  static void share(Gaussians& g, size_t i, int copies) {
    const Shared shared = shared_among(sigmoid(double{g.opacities[i]}), copies);
    g.opacities[i] = static_cast<float>(logit(shared.opacity));
    for (size_t axis = 0; axis < 3; axis++) g.scales[3 * i + axis] += static_cast<float>(std::log(shared.scale));
  }

  /// Gaussian `from` again in the place of `to`, which may be one past the end.
  static void place(Gaussians& g, size_t from, size_t to) {
    Gaussians one;
    append(one, g, from);
    if (to == g.count()) return append(g, one, 0);
    for (const auto& [name, values, width] : kGaussianArrays)
      std::copy((one.*values).begin(), (one.*values).end(),
                (g.*values).begin() + static_cast<std::ptrdiff_t>(to * width));
  }

  /// R S S R' x with x [G,3].
  static Tensor covariance_times(const Cloud& cloud, const Tensor& x) {
    const Tensor q = cloud.rotations * rsqrt(sum(square(cloud.rotations), {{1}, true}));
    const Tensor w = slice(q, 1, 0, 1), u = slice(q, 1, 1, 4);
    const auto cross = [](const Tensor& a, const Tensor& b) {
      const auto turn = [](const Tensor& v, int64_t by) { return concat({slice(v, 1, by, 3), slice(v, 1, 0, by)}, 1); };
      return turn(a, 1) * turn(b, 2) - turn(a, 2) * turn(b, 1);
    };
    const auto turned = [&](const Tensor& v, const Tensor& by) {
      const Tensor once = cross(u, v);
      return v + 2.f * by * once + 2.f * cross(u, once);
    };
    return turned(turned(x, -w) * exp(2.f * cloud.scales), w);
  }

  GrowthOptions options_;
};

}  // namespace

Shared shared_among(double opacity, int count) {
  Shared out{1 - std::pow(1 - std::min(opacity, 1 - 1e-7), 1.0 / count), 1};
  double sum = 0;
  for (int i = 1; i <= count; i++) {
    double binomial = 1;
    for (int k = 0; k < i; k++) {
      sum += binomial * (k % 2 == 0 ? 1 : -1) * std::pow(out.opacity, k + 1) / std::sqrt(k + 1.0);
      binomial = binomial * (i - 1 - k) / (k + 1);
    }
  }
  out.scale = opacity / sum;
  out.opacity = std::clamp(out.opacity, 0.005, 1 - 1e-7);
  return out;
}

std::unique_ptr<Growth> make_growth(const GrowthOptions& options, const CameraRegion& cameras) {
  if (options.strategy == "densify") return std::make_unique<Densify>(options, cameras);
  if (options.strategy == "mcmc") return std::make_unique<Mcmc>(options);
  throw Error(Fault::usage, text("setting growth.strategy: \"", options.strategy, "\", want densify or mcmc"));
}

}  // namespace cloam
