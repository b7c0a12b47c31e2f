// What the rows of max_pool2d cannot say: ties, infinities, NaN, and the sizes of results.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

TEST_CASE("the first of equal values in a window gets the gradient") {
  const Tensor x = parameter({1, 1, 0, 7, 1, 1, 7, 7}, {1, 1, 2, 4});
  const Tensor y = max_pool2d(x);
  CHECK(y.to_host() == std::vector<float>{1, 7});
  CHECK(grad(sum(y), {x})[0].to_host() == std::vector<float>{1, 0, 0, 1, 0, 0, 0, 0});
  const Tensor overlap = parameter(std::vector<float>(9, 2.f), {1, 1, 3, 3});
  CHECK(grad(sum(max_pool2d(overlap, {2, 1})), {overlap})[0].to_host() ==
        std::vector<float>{1, 1, 0, 1, 1, 0, 0, 0, 0});
}

TEST_CASE("max pooling passes infinities and NaN on") {
  constexpr float kInf = std::numeric_limits<float>::infinity(), kNaN = std::numeric_limits<float>::quiet_NaN();
  const Tensor x = parameter({-kInf, -kInf, 1, kNaN, -kInf, -kInf, 9, 2}, {1, 1, 2, 4});
  const Tensor y = max_pool2d(x);
  CHECK(y.to_host()[0] == -kInf);
  CHECK(std::isnan(y.to_host()[1]));
  CHECK(grad(sum(y), {x})[0].to_host() == std::vector<float>{1, 0, 0, 1, 0, 0, 0, 0});
}

TEST_CASE("the sizes of pooled images are those of Caffe and PyTorch") {
  CHECK(Pooling{3, 2, 0, true}.places(113) == 56);  // SqueezeNet on 227x227: conv1 leaves 111
  CHECK(Pooling{3, 2, 0, true}.places(111) == 55);
  CHECK(Pooling{3, 2, 0, true}.places(14) == 7);
  CHECK(Pooling{3, 2, 0, false}.places(14) == 6);
  CHECK(Pooling{2, 2, 1, true}.places(3) == 2);  // a third window would begin in the last zeros
  CHECK_THROWS_WITH_AS(max_pool2d(zeros({1, 1, 1, 5})), doctest::Contains("a window that fits"), Error);
}
