// Pictures compared: the loss of Gaussian splatting, three channels.
#include "runtime/ops/ssim.h"

#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

Tensor loss_of(const Tensor& x, const Tensor& y) {
  const Likeness alike = likeness(x, y);
  return alike.l1 * 0.8f + (1.f - alike.ssim) * 0.2f;
}

void add(Workloads& all, int64_t height, int64_t width) {
  const Shape shape{3, height, width};
  const std::string name = text("ssim.", height, "x", width);
  const double bytes = 4.0 * static_cast<double>(numel(shape));
  const auto picture = [shape](uint64_t seed) { return random_uniform(shape, {seed}).to_host(); };
  all.push_back({name + ".fwd",
                 0,
                 2 * bytes,
                 [=]() -> Run {
                   const Tensor x = from_host(picture(1), shape), y = from_host(picture(2), shape);
                   return [=] { eval({loss_of(x, y)}); };
                 },
                 {}});
  all.push_back({name + ".fwdbwd",
                 0,
                 3 * bytes,
                 [=]() -> Run {
                   const Tensor x = parameter(picture(1), shape), y = from_host(picture(2), shape);
                   return [=] {
                     const Tensor loss = loss_of(x, y);
                     Tensors all_of_it = grad(loss, {x});
                     all_of_it.push_back(loss);
                     eval(all_of_it);
                   };
                 },
                 {}});
}

}  // namespace

void add_ssim_workloads(Workloads& all) {
  add(all, 359, 640);
  add(all, 1066, 1600);
}

}  // namespace cloam
