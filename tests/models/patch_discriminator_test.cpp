// The patch discriminator: its size, and that it learns what tells two kinds of images apart.
#include "models/nn/patch_discriminator.h"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "models/train/optimiser.h"
#include "runtime/error.h"

using namespace cloam;

namespace {

/// A square of a quarter of the side, lighter or darker than what is around it; all images have the same mean.
Tensor squares(int64_t count, int64_t side, bool light, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<float> values;
  const auto below = [&](int64_t end) { return static_cast<int64_t>(random() % static_cast<unsigned>(end)); };
  for (int64_t n = 0; n < count; n++) {
    const double contrast = (light ? 1 : -1) * (0.2 + static_cast<double>(below(30)) / 100);
    const int64_t top = below(side * 3 / 4), left = below(side * 3 / 4);
    for (int64_t i = 0; i < 3 * side * side; i++) {
      const int64_t y = i / side % side - top, x = i % side - left;
      const bool inside = y >= 0 && y < side / 4 && x >= 0 && x < side / 4;
      values.push_back(static_cast<float>(0.5 + contrast * ((inside ? 1 : 0) - 1 / 16.0)));
    }
  }
  return from_host(values, {count, 3, side, side});
}

int64_t count_of(const Params& params) {
  int64_t count = 0;
  for (const auto& [name, tensor] : params) count += tensor.numel();
  return count;
}

}  // namespace

TEST_CASE("the patch discriminator has the shapes and the size of pix2pix's convolutions") {
  Params large, small;
  const PatchDiscriminator paper(Scope{large, "d", 1}), tiny(Scope{small, "d", 1}, {16, 32, 64});
  CHECK(count_of(large) == 3 * 64 * 16 + 64 + (64 * 128 + 128 * 256 + 256 * 512) * 16 + 512 + 1);
  CHECK(count_of(small) == 3 * 16 * 16 + 16 + (16 * 32 + 32 * 64) * 16 + 64 + 1);
  CHECK(paper(zeros({2, 3, 64, 96})).shape() == Shape{2, 1, 4, 6});
  CHECK(tiny(zeros({1, 3, 32, 16})).shape() == Shape{1, 1, 4, 2});
  CHECK_THROWS_WITH_AS(tiny(zeros({1, 3, 20, 32})), doctest::Contains("multiples of 8 from 16"), Error);
}

TEST_CASE("binary cross entropy of logits has its closed form and does not overflow") {
  const Tensor logits = from_host(std::vector<float>{-2.f, 0.5f}, {2, 1});
  const auto log_of = [](double x) { return std::log(1 + std::exp(x)); };
  CHECK(bce_with_logits(logits, 1).item() == doctest::Approx((log_of(2) + log_of(-0.5)) / 2).epsilon(1e-6));
  CHECK(bce_with_logits(logits, 0).item() == doctest::Approx((log_of(-2) + log_of(0.5)) / 2).epsilon(1e-6));
  CHECK(bce_with_logits(full({1}, 200.f), 0).item() == doctest::Approx(200));
}

TEST_CASE("the patch discriminator learns to tell two kinds of images apart, and gives images a gradient") {
  Params params;
  const PatchDiscriminator net(Scope{params, "", 1}, {8, 16});
  const ParameterGroups rates = {{"", 1e-2f}};
  Optimiser optimiser(params, rates);
  for (int64_t step = 1; step <= 40; step++) {
    const auto seed = static_cast<unsigned>(2 * step);
    const Tensor loss =
        bce_with_logits(net(squares(8, 16, true, seed)), 1) + bce_with_logits(net(squares(8, 16, false, seed + 1)), 0);
    Tensors wanted;
    for (const auto& [name, p] : params) wanted.push_back(p);
    const Tensors gradients = grad(loss, wanted);
    eval(gradients);
    optimiser.step(params, gradients, rates, {step});
  }
  const Tensor image = parameter(squares(16, 16, false, 1001).to_host(), {16, 3, 16, 16});
  const Tensor real = mean(net(squares(16, 16, true, 1000)), {{1, 2, 3}}), fake = mean(net(image), {{1, 2, 3}});
  int right = 0;
  for (const float logit : real.to_host()) right += logit > 0;
  for (const float logit : fake.to_host()) right += logit < 0;
  CHECK(right >= 29);  // of 32; a coin gets 16
  // A small step along the image's gradient makes it look more real.
  const Tensor gradient = grad(mean(fake), {image})[0];
  const Tensor better = image + gradient * (0.05f * rsqrt(mean(square(gradient))));
  CHECK(mean(net(better)).item() > mean(fake).item() + 0.1f);
}
