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

void CodeDenoising::write(const Tensor& standardised) {
  const auto width = static_cast<size_t>(rows_.own.dim(1));
  const std::vector<float> codes = denoiser_.codes(standardised).to_host(),
                           common = rows_.common ? rows_.common.to_host() : std::vector<float>(width, 0.f);
  std::vector<float> all = rows_.own.to_host();
  const size_t numbers = codes.size() / rows_.rows.size();
  for (size_t row = 0; row < rows_.rows.size(); ++row)
    for (size_t i = 0; i < numbers; ++i)
      all[static_cast<size_t>(rows_.rows[row]) * width + i] = codes[row * numbers + i] - common[i];
  assign({{rows_.own, from_host(all, rows_.own.shape())}});
}

void CodeDenoising::show(int64_t step) {
  clean_ = stop_gradient(clean(noisy_, step));
  eval({clean_});
  write(clean_);
}

void CodeDenoising::take(Step& rendering, const Tensors& wanted) {
  gradient_ = Tensor();
  for (size_t i = 0; i < wanted.size(); ++i) {
    Tensor& by = rendering.gradients[i];
    if (by && wanted[i].node() == rows_.own.node()) {
      const auto count = static_cast<int64_t>(rows_.rows.size()), numbers = clean_.numel() / count;
      const Tensor of_rows = gather_rows(by, from_host(rows_.rows, {count}));
      gradient_ = denoiser_.gradient(reshape(slice(of_rows, 1, 0, numbers), clean_.shape()));
    }
    if (wanted[i].node() == rows_.own.node() || (rows_.common && wanted[i].node() == rows_.common.node()))
      by = Tensor();
  }
  if (gradient_) rendering.more.push_back(gradient_);
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
