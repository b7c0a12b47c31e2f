// Adam (Kingma and Ba 2015), dense and by rows.
#include "models/train/optimiser.h"

#include <algorithm>
#include <map>

#include "models/io/tensors.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"
#include "runtime/ops/adam.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

std::vector<Shape> shapes_of(const std::vector<size_t>& places, const Tensors& parameters) {
  std::vector<Shape> shapes;
  for (const size_t place : places) shapes.push_back(parameters[place].shape());
  return shapes;
}

bool fit_one_buffer(const std::vector<Shape>& shapes) {
  return static_cast<uint64_t>(flat_size(shapes)) * size_of(DType::f32) <= device().max_alloc_bytes;
}

}  // namespace

Optimiser::Optimiser(const Params& parameters, const ParameterGroups& groups, const Ranks& ranks) : ranks_(&ranks) {
  std::map<std::string, std::vector<size_t>> dense;  // by the group's prefix
  for (const auto& [name, p] : parameters) {
    const ParameterGroup& group = group_of(name, groups);
    if (group.frozen) continue;
    if (!group.sparse) dense[group.prefix].push_back(names_.size());
    names_.push_back(name);
    if (!group.sparse) continue;
    m_[name] = made_to_stay(zeros(p.shape()));
    v_[name] = made_to_stay(zeros(p.shape()));
    steps_[name] = from_host(std::vector<int32_t>(static_cast<size_t>(p.dim(0)), 0), {p.dim(0)});
    if (auto common = memory_in_common(*ranks_, {p.shape()}, {p.dim(0), row_width(p.shape())}))
      sparse_in_common_[name] = *std::move(common);
  }
  const Tensors in_order = wanted(parameters);
  for (const auto& [prefix, places] : dense) {
    std::vector<size_t> order = flats_.empty() ? places : flats_.back().order;
    if (!flats_.empty()) order.insert(order.end(), places.begin(), places.end());
    if (flats_.empty() || !fit_one_buffer(shapes_of(order, in_order))) flats_.emplace_back();
    Flats& flats = flats_.back();
    flats.groups.push_back({prefix, flats.order.size(), flats.order.size() + places.size(), {}, {}, {}, {}});
    flats.order.insert(flats.order.end(), places.begin(), places.end());
  }
  for (Flats& flats : flats_) make(flats, in_order);
}

void Optimiser::make(Flats& flats, const Tensors& parameters) {
  const std::vector<Shape> shapes = shapes_of(flats.order, parameters);
  if (std::optional<StepMemory> common = memory_in_common(*ranks_, shapes, {flat_size(shapes)}))
    flats.memory = *std::move(common);
  else
    flats.memory = {flat_zeros(shapes), flat_zeros(shapes), {}};
  flats.m = flat_zeros(shapes);
  flats.v = flat_zeros(shapes);
  gather_parameters(flats, parameters);
  for (size_t i = 0; i < flats.order.size(); i++) {
    m_[names_[flats.order[i]]] = flats.m.parts[i];
    v_[names_[flats.order[i]]] = flats.v.parts[i];
  }
  for (Group& group : flats.groups) {
    group.parameters = joined(flats.memory.parameters, group.begin, group.end);
    group.m = joined(flats.m, group.begin, group.end);
    group.v = joined(flats.v, group.begin, group.end);
    group.gradients = joined(flats.memory.gradients, group.begin, group.end);
  }
}

Tensors Optimiser::wanted(const Params& parameters) const {
  Tensors out;
  for (const std::string& name : names_) out.push_back(parameters.at(name));
  return out;
}

void Optimiser::expect(Tensors& gradients) const {
  for (const Flats& flats : flats_) {
    for (size_t i = 0; i < flats.order.size(); i++) {
      Tensor& gradient = gradients[flats.order[i]];
      if (!gradient) gradient = zeros(flats.memory.gradients.parts[i].shape());
      expect_at(gradient, flats.memory.gradients.parts[i]);
    }
  }
  for (size_t i = 0; i < names_.size(); i++) {
    const auto common = sparse_in_common_.find(names_[i]);
    if (common != sparse_in_common_.end() && gradients[i]) expect_at(gradients[i], common->second.gradients.parts[0]);
  }
}

Tensors Optimiser::buffers_of(const Tensors& gradients) {
  Tensors out;
  for (Flats& flats : flats_) {
    for (size_t i = 0; i < flats.order.size(); i++) put_at(gradients[flats.order[i]], flats.memory.gradients.parts[i]);
    out.push_back(flats.memory.gradients.all);
  }
  for (size_t i = 0; i < names_.size(); i++)
    if (steps_.contains(names_[i])) out.push_back(gradients[i] ? in_place(names_[i], gradients[i]) : gradients[i]);
  return out;
}

/// A sparse parameter's gradient, where it is read.
Tensor Optimiser::in_place(const std::string& name, const Tensor& gradient) const {
  const auto common = sparse_in_common_.find(name);
  if (common == sparse_in_common_.end()) return dense(gradient);
  put_at(gradient, common->second.gradients.parts[0]);
  return common->second.gradients.parts[0];
}

const StepMemory* Optimiser::in_common(size_t buffer) const {
  if (buffer < flats_.size()) return flats_[buffer].memory.rows_of_ranks.empty() ? nullptr : &flats_[buffer].memory;
  size_t next = flats_.size();
  for (const auto& [name, steps] : steps_) {  // in the order of the names, as the buffers
    if (next++ < buffer) continue;
    const auto common = sparse_in_common_.find(name);
    return common == sparse_in_common_.end() ? nullptr : &common->second;
  }
  return nullptr;
}

bool Optimiser::has_common() const {
  for (size_t i = 0; i < flats_.size() + steps_.size(); i++)
    if (in_common(i)) return true;
  return false;
}

std::vector<Shape> Optimiser::buffer_shapes() const {
  std::vector<Shape> out;
  for (const Flats& flats : flats_) out.push_back(flats.memory.gradients.all.shape());
  for (const std::string& name : names_)
    if (steps_.contains(name)) out.push_back(m_.at(name).shape());
  return out;
}

/// assign() may have moved them away.
void Optimiser::gather_parameters(const Flats& flats, const Tensors& parameters) const {
  for (size_t i = 0; i < flats.order.size(); i++) move_to(parameters[flats.order[i]], flats.memory.parameters.parts[i]);
}

namespace {

AdamStep step_of(const ParameterGroup& group, const Progress& progress) {
  return {group.rate_at(progress), group.beta1, group.beta2, group.epsilon, group.decay, progress.step};
}

AdamStep step_of(const std::string& prefix, const ParameterGroups& groups, const Progress& progress) {
  const auto group = std::find_if(groups.begin(), groups.end(), [&](const auto& one) { return one.prefix == prefix; });
  if (group == groups.end()) throw Error(Fault::internal, text("the parameter group ", prefix, "* is missing"));
  return step_of(*group, progress);
}

}  // namespace

void Optimiser::step(Params& parameters, const Tensors& gradients, const ParameterGroups& groups,
                     const Progress& progress) {
  for (size_t i = 0; i < names_.size(); i++) {
    const std::string& name = names_[i];
    if (!gradients[i] || !steps_.contains(name)) continue;
    adam_step_rows(parameters.at(name), m_[name], v_[name], steps_[name], gradients[i],
                   step_of(group_of(name, groups), progress));
  }
  const Tensors in_order = wanted(parameters);
  for (Flats& flats : flats_) {
    gather_parameters(flats, in_order);
    for (size_t i = 0; i < flats.order.size(); i++) put_at(gradients[flats.order[i]], flats.memory.gradients.parts[i]);
    for (Group& group : flats.groups)
      adam_step(group.parameters, group.m, group.v, group.gradients, step_of(group.prefix, groups, progress));
  }
}

namespace {

AdamStep::Rows rows_of(const Share& share, const Tensor& buffer) {
  return {share.begin(buffer.dim(0)), share.end(buffer.dim(0))};
}

}  // namespace

void Optimiser::step_own(Flats& flats, const RowsStep& how) {
  const AdamStep::Rows own = rows_of(how.progress.share, flats.memory.gradients.all);
  for (Group& group : flats.groups) {
    const int64_t base = flats.memory.gradients.begins[group.begin], end = flats.memory.gradients.begins[group.end];
    AdamStep with = step_of(group.prefix, how.groups, how.progress);
    with.rows = {std::clamp(own.begin, base, end) - base, std::clamp(own.end, base, end) - base};
    adam_step(group.parameters, group.m, group.v, group.gradients, with);
  }
}

void Optimiser::gather(const Params& parameters) const {
  const Tensors in_order = wanted(parameters);
  for (const Flats& flats : flats_) gather_parameters(flats, in_order);
  for (const auto& [name, common] : sparse_in_common_) move_to(parameters.at(name), common.parameters.parts[0]);
}

void Optimiser::step_rows(Params& parameters, const Tensors& gradients, const RowsStep& how) {
  for (Flats& flats : flats_) step_own(flats, how);
  size_t next = flats_.size();
  for (const std::string& name : names_) {
    if (!steps_.contains(name)) continue;
    const Tensor& gradient = gradients[next++];
    if (!gradient) continue;
    Tensor& parameter = parameters.at(name);
    AdamStep with = step_of(group_of(name, how.groups), how.progress);
    with.rows = rows_of(how.progress.share, parameter);
    adam_step_rows(parameter, m_[name], v_[name], steps_[name], gradient, with);
  }
}

Tensors Optimiser::stepped(const Params& parameters) const {
  Tensors out;
  for (const Flats& flats : flats_) out.push_back(flats.memory.parameters.all);
  for (const std::string& name : names_)
    if (steps_.contains(name)) out.push_back(parameters.at(name));
  for (size_t i = 0; i < out.size(); i++)
    if (in_common(i)) out[i] = Tensor();
  return out;
}

Tensors Optimiser::moments() const {
  Tensors out;
  for (const Flats& flats : flats_) out.insert(out.end(), {flats.m.all, flats.v.all});
  for (const auto& [name, steps] : steps_) out.insert(out.end(), {m_.at(name), v_.at(name), steps});
  return out;
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

void Optimiser::move_rows(const Params& parameters, const RowMoves& moves, const ParameterGroups& groups) {
  const Params m = m_, v = v_, steps = steps_;
  *this = Optimiser(parameters, groups, *ranks_);
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
  for (const Flats& flats : flats_) sums.push_back(sum(flats.memory.parameters.all * 0.f));
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
