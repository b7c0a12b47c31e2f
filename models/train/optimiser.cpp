// Adam (Kingma and Ba 2015), dense and by rows.
#include "models/train/optimiser.h"

#include "models/train/tensors.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {

const LearningRate& rate_of(const std::string& name, const std::vector<LearningRate>& rates) {
  const LearningRate* best = nullptr;
  for (const LearningRate& rate : rates)
    if (name.starts_with(rate.prefix) && (!best || rate.prefix.size() > best->prefix.size())) best = &rate;
  if (!best) throw Error(Fault::internal, text("no learning rate is given for parameter ", name));
  return *best;
}

Optimiser::Optimiser(const Params& parameters, const std::vector<LearningRate>& rates) {
  for (const auto& [name, p] : parameters) {
    const std::vector<float> zero(static_cast<size_t>(p.numel()), 0.f);
    m_[name] = from_host(zero, p.shape());
    v_[name] = from_host(zero, p.shape());
    if (rate_of(name, rates).sparse)
      steps_[name] = from_host(std::vector<int32_t>(static_cast<size_t>(p.dim(0)), 0), {p.dim(0)});
  }
}

void Optimiser::step(Params& parameters, const Tensors& gradients, const std::vector<LearningRate>& rates,
                     const AdamSettings& adam, int64_t step) {
  size_t i = 0;
  for (auto& [name, p] : parameters) {
    AdamStep with{rate_of(name, rates).rate, adam.beta1, adam.beta2, adam.epsilon, 0.f, step};
    const Tensor& gradient = gradients[i++];
    if (steps_.contains(name))
      adam_step_rows(p, m_[name], v_[name], steps_[name], gradient, with);
    else
      adam_step(p, m_[name], v_[name], gradient, with);
  }
}

TensorMap Optimiser::state() const {
  TensorMap out;
  for (const auto& [name, m] : m_) out["m." + name] = named(m);
  for (const auto& [name, v] : v_) out["v." + name] = named(v);
  for (const auto& [name, steps] : steps_) out["steps." + name] = named(steps);
  return out;
}

void Optimiser::restore(const TensorMap& state) {
  for (auto& [name, m] : m_) m = tensor_from(state, "m." + name, m.shape());
  for (auto& [name, v] : v_) v = tensor_from(state, "v." + name, v.shape());
  for (auto& [name, steps] : steps_) steps = tensor_from(state, "steps." + name, steps.shape());
}

}  // namespace cloam
