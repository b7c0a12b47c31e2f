// A tensor program with a gradient: fits y = slope x + offset to points by gradient descent on a device of OpenCL's.
#include <cstdio>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops.h"

int main() try {
  using namespace cloam;
  const Tensor x = from_host(std::vector<float>{0, 1, 2, 3}, {4}), y = from_host(std::vector<float>{1, 3, 5, 7}, {4});
  const Tensor slope = parameter({0}, {1}), offset = parameter({0}, {1});
  for (int step = 0; step < 500; ++step) {
    const Tensor loss = mean(square(slope * x + offset - y));
    const Tensors gradients = grad(loss, {slope, offset});
    assign({{slope, slope - gradients[0] * 0.1f}, {offset, offset - gradients[1] * 0.1f}});
  }
  std::printf("y = %.3f x + %.3f, on %s\n", slope.item(), offset.item(), device().name.c_str());
} catch (const cloam::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return static_cast<int>(error.fault());
}
