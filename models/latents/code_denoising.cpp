// See code_denoising.h.
#include "models/latents/code_denoising.h"

#include <algorithm>

#include "models/diffusion/guidance.h"
#include "models/diffusion/sampler.h"
#include "models/io/tensors.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr uint32_t kStart = 0;  // step of the random numbers that denoising begins with: no training step's

}  // namespace

CodeDenoising::CodeDenoising(const CodeDenoiser& denoiser, const CodePriorOptions& options, CodeRows rows,
                             uint64_t seed)
    : denoiser_(denoiser),
      options_(options),
      rows_(std::move(rows)),
      times_(sampling_timesteps(denoiser.schedule.timesteps(), options.steps)) {
  const auto channels = static_cast<int64_t>(denoiser_.mean.size());
  const Shape shape = {static_cast<int64_t>(rows_.rows.size()), channels, denoiser_.side, denoiser_.side};
  noisy_ = random_normal(shape, {seed, kStart, kPriorNoise}) * options.noise;
  eval({noisy_});
}

/// Of the start of training step 1, 2, ...; one further: the clean end.
Level CodeDenoising::level(size_t step) const {
  return denoiser_.schedule.level(step <= times_.size() ? times_[step - 1] : -1);
}

Tensor CodeDenoising::clean(const Tensor& noisy, int64_t step) const {
  const auto time = static_cast<int32_t>(times_[static_cast<size_t>(step) - 1]);
  return denoiser_.clean(noisy, std::vector<int32_t>(rows_.rows.size(), time), rows_.condition);
}

void CodeDenoising::write(const Tensor& standardised) const { rows_.write(denoiser_.codes(standardised).to_host()); }

void CodeDenoising::show(int64_t step) {
  clean_ = stop_gradient(clean(noisy_, step));
  eval({clean_});
  write(clean_);
}

void CodeDenoising::take(Step& rendering, const Tensors& wanted) {
  const Tensor by_codes = rows_.take_gradient(rendering, wanted, clean_.numel() / clean_.dim(0));
  gradient_ = by_codes ? denoiser_.gradient(reshape(by_codes, clean_.shape())) : Tensor();
  if (!gradient_) return;
  if (rendering.weight > 0) gradient_ = gradient_ * static_cast<float>(rendering.weight);
  rendering.more.push_back(gradient_);
  rendering.sums.push_back(gradient_);
}

void CodeDenoising::advance(int64_t step) {
  const Level from = level(static_cast<size_t>(step)), to = level(static_cast<size_t>(step) + 1);
  Tensor now = clean_;
  if (gradient_) {
    const Tensor noisy = parameter(noisy_.to_host(), noisy_.shape());
    now = guided_clean(clean_, grad(clean(noisy, step), {noisy}, gradient_).front(), from, options_.guidance);
  }
  const DenoisingStep by = ddim_step(from, to, 0);
  noisy_ = stop_gradient(noisy_ * by.noisy + now * by.clean);
  eval({noisy_, now});
  write(now);
  gradient_ = Tensor();
}

TensorMap CodeDenoising::state() const { return {{"noisy", named(noisy_)}}; }

void CodeDenoising::restore(const TensorMap& state) { noisy_ = tensor_from(state, "noisy", noisy_.shape()); }

}  // namespace cloam
