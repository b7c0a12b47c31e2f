// See code_prior.h.
#include "models/latents/code_prior.h"

#include <cmath>

#include "models/diffusion/guidance.h"
#include "models/io/host_random.h"
#include "models/io/tensors.h"
#include "models/latents/code_denoising.h"
#include "models/latents/code_guess.h"
#include "models/nn/ema.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr float kMinTime = 0.02f, kMaxTime = 0.98f;  // of all diffusion times: DreamFusion's
constexpr double kNormDecay = 0.99;
constexpr int64_t kMeasuring = 16;  // steps: a term of early times is hundreds of times smaller than one of late times
constexpr char kDiffusion[] = "diffusion", kNearest[] = "nearest";
constexpr uint64_t kTimesSeed = 0x7072696f72;  // apart from the numbers that choose what a step sees

}  // namespace

CodePrior::CodePrior(const CodeDenoiser& denoiser, const CodePriorOptions& options, uint64_t seed)
    : denoiser_(denoiser), options_(options), seed_(seed) {
  if (options.start != kDiffusion) options_.weight = 0;
}

CodePrior::~CodePrior() = default;

void CodePrior::find(CodeRows rows, std::function<std::vector<double>()> errors) {
  if (rows.rows.empty() || options_.steps == 0) return;
  if (options_.start == kDiffusion) {
    start_ = std::make_unique<CodeDenoising>(denoiser_, options_, std::move(rows), seed_);
    return;
  }
  const CodeGuessKind kind = options_.start == kNearest ? CodeGuessKind::nearest : CodeGuessKind::class_mean;
  start_ = std::make_unique<CodeGuess>(denoiser_, kind, options_.steps, std::move(rows), std::move(errors));
}

/// Each actor at a time of its own.
Tensor CodePrior::term(const VisibleCodes& met, const Progress& progress) const {
  HostRandom random(seed_ ^ kTimesSeed, static_cast<uint64_t>(progress.step));
  const auto all = static_cast<float>(denoiser_.schedule.timesteps());
  std::vector<int32_t> times;
  for (int64_t i = 0; i < met.codes.dim(0); ++i)
    times.push_back(static_cast<int32_t>((kMinTime + (kMaxTime - kMinTime) * random.uniform()) * all));
  const Tensor noise = random_normal(met.codes.shape(), {seed_, static_cast<uint32_t>(progress.step), kPriorNoise});
  const auto clean = [&](const Tensor& noisy, const std::vector<int32_t>& at) {
    return denoiser_.clean(noisy, at, met.condition);
  };
  return distillation(denoiser_.schedule, clean, denoiser_.standardised(met.codes), times, noise,
                      options_.through_network ? NetworkGradient::included : NetworkGradient::left_out);
}

void CodePrior::begin_step(const Progress& progress) {
  if (start_ && start_->includes(progress.step)) start_->show(progress.step);
}

void CodePrior::add(Step& step, const Tensors& wanted, const VisibleCodes& met, const Progress& progress) {
  norms_ = Tensor();
  if (start_ && start_->includes(progress.step)) return start_->take(step, wanted);
  if (options_.weight == 0) return;
  const bool alone = progress.share.ranks == 1;
  if (!met.codes) {
    if (!alone) step.sums.push_back(norms_ = zeros({3}));
    return;
  }
  const Tensor of_prior = term(met, progress);
  const Tensors by = grad_where_reached(of_prior, wanted);
  const float scale = weight();
  Tensor rendering = zeros({}), prior = zeros({});
  for (size_t i = 0; i < wanted.size(); ++i) {
    if (!by[i]) continue;
    Tensor& all = step.gradients[i];
    if (all) rendering = rendering + sum(square(all));
    prior = prior + sum(square(by[i]));
    all = all ? all + by[i] * scale : by[i] * scale;
  }
  step.loss = step.loss + stop_gradient(of_prior) * scale;
  norms_ = concat({reshape(sqrt(rendering), {1}), reshape(sqrt(prior), {1}), ones({1})}, 0);
  step.more.push_back(norms_);
  if (!alone) step.sums.push_back(norms_);
}

void CodePrior::end_step(const Progress& progress) {
  if (start_ && start_->includes(progress.step)) start_->advance(progress.step);
  if (!norms_) return;
  const std::vector<float> now = norms_.to_host();
  if (now[2] == 0) return;
  const auto kept = static_cast<float>(warm_decay(kNormDecay, ++measured_));
  rendering_ = kept * rendering_ + (1 - kept) * now[0] / now[2];
  term_ = kept * term_ + (1 - kept) * now[1] / now[2];
  norms_ = Tensor();
}

float CodePrior::weight() const {
  return measured_ >= kMeasuring && term_ > 0 ? options_.weight * rendering_ / term_ : 0;
}

TensorMap CodePrior::state() const {
  TensorMap out = start_ ? start_->state() : TensorMap{};
  out["norms"] = named(from_host(std::vector<float>{rendering_, term_}, {2}));
  out["measured"] = named_integers({measured_});
  return out;
}

void CodePrior::restore(const TensorMap& state) {
  const std::vector<float> norms = tensor_from(state, "norms", {2}).to_host();
  rendering_ = norms[0];
  term_ = norms[1];
  measured_ = integers_from(state, "measured", 1).front();
  if (start_) start_->restore(state);
}

}  // namespace cloam
