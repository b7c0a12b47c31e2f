// Adam (Kingma and Ba 2015), dense and by rows.
#include "models/train/optimiser.h"

#include <algorithm>
#include <set>

#include "models/train/tensors.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"
#include "runtime/ops/adam.h"

namespace cloam {

const LearningRate& rate_of(const std::string& name, const std::vector<LearningRate>& rates) {
  const LearningRate* best = nullptr;
  for (const LearningRate& rate : rates)
    if (name.starts_with(rate.prefix) && (!best || rate.prefix.size() > best->prefix.size())) best = &rate;
  if (!best) throw Error(Fault::internal, text("no learning rate is given for parameter ", name));
  return *best;
}

namespace {

float rate_with(const std::string& prefix, const std::vector<LearningRate>& rates) {
  const auto found =
      std::find_if(rates.begin(), rates.end(), [&](const LearningRate& rate) { return rate.prefix == prefix; });
  if (found == rates.end()) throw Error(Fault::internal, text("the learning rate of ", prefix, "* went away"));
  return found->rate;
}

}  // namespace

Optimiser::Optimiser(const Params& parameters, const std::vector<LearningRate>& rates) {
  std::set<std::string> prefixes;
  for (const auto& [name, p] : parameters) {
    const LearningRate& rate = rate_of(name, rates);
    if (rate.frozen) continue;
    names_.push_back(name);
    if (!rate.sparse) {
      prefixes.insert(rate.prefix);
      continue;
    }
    m_[name] = dense(zeros(p.shape()));
    v_[name] = dense(zeros(p.shape()));
    steps_[name] = from_host(std::vector<int32_t>(static_cast<size_t>(p.dim(0)), 0), {p.dim(0)});
  }
  for (const std::string& prefix : prefixes) add_group(prefix, parameters, rates);
}

void Optimiser::add_group(const std::string& prefix, const Params& parameters, const std::vector<LearningRate>& rates) {
  Group group;
  group.prefix = prefix;
  std::vector<Shape> shapes;
  std::vector<std::string> names;
  for (size_t place = 0; place < names_.size(); place++) {
    if (rate_of(names_[place], rates).prefix != prefix) continue;
    group.order.push_back(place);
    shapes.push_back(parameters.at(names_[place]).shape());
    names.push_back(names_[place]);
  }
  for (Flat* flat : {&group.parameters, &group.m, &group.v, &group.gradients}) *flat = flat_zeros(shapes);
  for (size_t i = 0; i < names.size(); i++) {
    move_to(parameters.at(names[i]), group.parameters.parts[i]);
    m_[names[i]] = group.m.parts[i];
    v_[names[i]] = group.v.parts[i];
  }
  groups_.push_back(std::move(group));
}

Tensors Optimiser::wanted(const Params& parameters) const {
  Tensors out;
  for (const std::string& name : names_) out.push_back(parameters.at(name));
  return out;
}

void Optimiser::expect(Tensors& gradients) const {
  for (const Group& group : groups_) {
    for (size_t i = 0; i < group.order.size(); i++) {
      Tensor& gradient = gradients[group.order[i]];
      if (!gradient) gradient = zeros(group.gradients.parts[i].shape());
      expect_at(gradient, group.gradients.parts[i]);
    }
  }
}

void Optimiser::step_group(Group& group, const Tensors& parameters, const Tensors& gradients, const AdamStep& with) {
  for (size_t i = 0; i < group.order.size(); i++) {
    move_to(parameters[group.order[i]], group.parameters.parts[i]);  // assign() may have moved it away
    put_at(gradients[group.order[i]], group.gradients.parts[i]);
  }
  adam_step(group.parameters.all, group.m.all, group.v.all, group.gradients.all, with);
}

void Optimiser::step(Params& parameters, const Tensors& gradients, const std::vector<LearningRate>& rates,
                     const AdamSettings& adam, int64_t step) {
  const auto with = [&](float rate, float decay) {
    return AdamStep{rate, adam.beta1, adam.beta2, adam.epsilon, decay, step};
  };
  for (size_t i = 0; i < names_.size(); i++) {
    const std::string& name = names_[i];
    if (!gradients[i] || !steps_.contains(name)) continue;
    const LearningRate& rate = rate_of(name, rates);
    adam_step_rows(parameters.at(name), m_[name], v_[name], steps_[name], gradients[i], with(rate.rate, rate.decay));
  }
  const Tensors in_order = wanted(parameters);
  for (Group& group : groups_) step_group(group, in_order, gradients, with(rate_with(group.prefix, rates), 0));
}

namespace {

/// Rows of `from` in their new places; zeros for new ones.
Tensor moved(const Tensor& from, const std::vector<int32_t>& source) {
  const auto count = static_cast<int64_t>(source.size());
  std::vector<int32_t> kept;
  for (const int32_t row : source) kept.push_back(row < 0 ? 0 : 1);
  Shape wide = Shape::filled(from.rank(), 1);
  wide[0] = count;
  const Tensor rows = gather_rows(from, from_host(source, {count}));
  return where(reshape(from_host(kept, {count}), wide), rows, cast(Tensor(0), from.dtype()));
}

}  // namespace

void Optimiser::move_rows(const Params& parameters, const RowMoves& moves, const std::vector<LearningRate>& rates) {
  const Params m = m_, v = v_, steps = steps_;
  *this = Optimiser(parameters, rates);
  for (const std::string& name : names_) {
    const auto move = std::find_if(moves.begin(), moves.end(), [&](const RowMove& row) { return row.name == name; });
    const auto follow = [&](const Params& from, Params& to) {
      const auto found = from.find(name);
      if (found == from.end()) return;
      put_at(move == moves.end() ? found->second : moved(found->second, move->source), to.at(name));
    };
    follow(m, m_);
    follow(v, v_);
    follow(steps, steps_);
  }
}

/// NaN and infinity times 0 are NaN, and so is a sum with one of them.
bool Optimiser::finite(const Params& parameters) const {
  Tensors sums;
  for (const Group& group : groups_) sums.push_back(sum(group.parameters.all * 0.f));
  for (const auto& [name, steps] : steps_) sums.push_back(sum(parameters.at(name) * 0.f));
  eval(sums);
  return std::all_of(sums.begin(), sums.end(), [](const Tensor& zero) { return zero.item() == 0; });
}

TensorMap Optimiser::state() const {
  TensorMap out;
  for (const auto& [name, m] : m_) out["m." + name] = named(m);
  for (const auto& [name, v] : v_) out["v." + name] = named(v);
  for (const auto& [name, steps] : steps_) out["steps." + name] = named(steps);
  return out;
}

void Optimiser::restore(const TensorMap& state) {
  for (auto& [name, m] : m_) put_at(tensor_from(state, "m." + name, m.shape()), m);
  for (auto& [name, v] : v_) put_at(tensor_from(state, "v." + name, v.shape()), v);
  for (auto& [name, steps] : steps_) steps = tensor_from(state, "steps." + name, steps.shape());
}

}  // namespace cloam
