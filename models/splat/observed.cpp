// See observed.h.
#include "models/splat/observed.h"

#include <algorithm>

#include "models/io/tensors.h"

namespace cloam {

void Observed::restart(int64_t count) {
  gradient_sums_ = zeros({count});
  views_ = zeros({count});
  gradient_ = listed_ = Tensor();
}

/// |d loss / d mean|, in units of half the picture, of the gaussians that some tile lists.
void Observed::add(const Drawn& drawn, const Tensor& by_means) {
  const SplatTiles& tiles = drawn.tiles;
  const int64_t count = drawn.seen.dim(0);
  listed_ = cast(listed(tiles), DType::f32);
  const Tensor gradient = by_means ? stop_gradient(by_means) : zeros({count, 2});
  const Tensor half = from_host(
      std::vector<float>{0.5f * static_cast<float>(tiles.width), 0.5f * static_cast<float>(tiles.height)}, {1, 2});
  gradient_ = sqrt(sum(square(slice(gradient, 1, 0, 2) * half), {{1}}));
}

void Observed::take() {
  if (!listed_) return;
  gradient_sums_ = gradient_sums_ + gradient_;
  views_ = views_ + listed_;
  gradient_ = listed_ = Tensor();
}

GrowthStatistics Observed::statistics() const {
  GrowthStatistics out;
  const std::vector<float> sums = gradient_sums_.to_host(), views = views_.to_host();
  for (size_t i = 0; i < sums.size(); i++) out.gradients.push_back(sums[i] / std::max(1.f, views[i]));
  return out;
}

TensorMap Observed::state() const { return {{"gradient_sums", named(gradient_sums_)}, {"views", named(views_)}}; }

void Observed::restore(const TensorMap& state) {
  gradient_sums_ = tensor_from(state, "gradient_sums", gradient_sums_.shape());
  views_ = tensor_from(state, "views", views_.shape());
}

}  // namespace cloam
