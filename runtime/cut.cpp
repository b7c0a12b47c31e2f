// From graph to launches. Two rules (measured in the design): recompute a short chain rather than store it for several
// users; cut, never fail, when a kernel would read too many tensors.
#include <algorithm>
#include <set>
#include <unordered_map>

#include "runtime/plan.h"

namespace cloam {
namespace {

constexpr int kMaxRecompute = 16;  // steps worth doing twice instead of storing
constexpr int kMaxCode = 1024;     // steps in one kernel: compile time
constexpr int kMergeWindow = 24;   // how many earlier groups a sibling looks back over

/// What is known of a node.
struct State {
  std::vector<int> users;
  std::set<int> roots;      // kernels this pointwise node is part of
  std::vector<int> leaves;  // tensors it reads when written into a kernel
  int cost = 1;
  int scalars = 0;  // constants in it when written into a kernel
  bool inlined = false, output = false;
  int ready = -1;  // step that produces it; -1: there from the start
  int group = -1;  // group that produces it
};

/// The nodes of a walk, as all parts of the cut see them.
struct Nodes {
  Node* node(int i) const { return walk.nodes[static_cast<size_t>(i)]; }
  State& at(int i) const { return states[static_cast<size_t>(i)]; }
  int size() const { return static_cast<int>(walk.nodes.size()); }
  int shape_id(int i) const { return walk.shape_ids[static_cast<size_t>(i)]; }
  bool pending(int i) const { return node(i)->op && !node(i)->storage.buffer; }
  OpKind kind(int i) const { return node(i)->op->kind(); }
  bool pointwise(int i) const { return pending(i) && kind(i) == OpKind::pointwise; }
  bool reduction(int i) const { return pending(i) && kind(i) == OpKind::reduce; }
  bool constant(int i) const { return pending(i) && kind(i) == OpKind::constant; }

  const Walk& walk;
  std::vector<State>& states;
};

// ---- Which nodes are written into the kernels of their users.

struct Inliner : Nodes {
  void find_users();
  void choose_inlined();
  bool joins_users(int i);
  bool store_widest(int i);
  void limit_inputs();
  std::vector<int> leaves_of(int i);
  void count_scalars(int i);
};

void Inliner::find_users() {
  for (int i = 0; i < size(); i++) {
    if (!pending(i)) continue;
    for (const Tensor& in : node(i)->in) at(in.node()->index).users.push_back(i);
  }
  for (int i : walk.outputs) at(i).output = true;
}

bool Inliner::joins_users(int i) {
  if (at(i).output || at(i).users.empty()) return false;
  for (int user : at(i).users) {
    const bool same_space =
        (kind(user) == OpKind::pointwise && shape_id(user) == shape_id(i)) || kind(user) == OpKind::reduce;
    if (!same_space) return false;
  }
  return true;
}

void Inliner::choose_inlined() {
  for (int i = 0; i < size(); i++) {
    if (!pointwise(i)) continue;
    for (const Tensor& in : node(i)->in)
      if (pointwise(in.node()->index)) at(i).cost = std::min(2000, at(i).cost + at(in.node()->index).cost);
  }
  for (int i = size() - 1; i >= 0; i--) {
    if (reduction(i)) at(i).roots = {i};
    if (!pointwise(i)) continue;
    const bool joins = joins_users(i);
    for (int user : at(i).users) at(i).roots.insert(at(user).roots.begin(), at(user).roots.end());
    at(i).inlined = joins && (at(i).roots.size() == 1 || at(i).cost <= kMaxRecompute);
    if (!at(i).inlined) at(i).roots = {i};
  }
}

std::vector<int> Inliner::leaves_of(int i) {
  std::vector<int> leaves;
  for (const Tensor& in : node(i)->in) {
    const int at_in = in.node()->index;
    if (constant(at_in)) continue;
    if (at(at_in).inlined)
      leaves.insert(leaves.end(), at(at_in).leaves.begin(), at(at_in).leaves.end());
    else
      leaves.push_back(at_in);
  }
  std::sort(leaves.begin(), leaves.end());
  leaves.erase(std::unique(leaves.begin(), leaves.end()), leaves.end());
  return leaves;
}

void Inliner::count_scalars(int i) {
  at(i).scalars = 0;
  for (const Tensor& in : node(i)->in) {
    const int operand = in.node()->index;
    at(i).scalars += constant(operand) ? 1 : at(operand).inlined ? at(operand).scalars : 0;
  }
}

/// Stores the operand that brings most after all, until a kernel reads no more than it can. Whether it had to.
bool Inliner::store_widest(int i) {
  bool stored = false;
  while (at(i).leaves.size() > kMaxInputs || at(i).cost > kMaxCode || at(i).scalars > kMaxScalars) {
    int widest = -1;
    for (const Tensor& in : node(i)->in) {
      const int operand = in.node()->index;
      if (at(operand).inlined && (widest < 0 || at(operand).leaves.size() > at(widest).leaves.size())) widest = operand;
    }
    if (widest < 0) break;
    at(widest).inlined = false;
    stored = true;
    at(i).leaves = leaves_of(i);
    count_scalars(i);
    at(i).cost = 1;
    for (const Tensor& in : node(i)->in)
      if (at(in.node()->index).inlined) at(i).cost += at(in.node()->index).cost;
  }
  return stored;
}

/// Goes up the graph, again after each time that a value was stored: its other users read that too then, and can come
/// to read too much.
void Inliner::limit_inputs() {
  for (bool stored = true; stored;) {
    stored = false;
    for (int i = 0; i < size(); i++) {
      if (!pointwise(i) && !reduction(i)) continue;
      at(i).leaves = leaves_of(i);
      count_scalars(i);
      stored |= store_widest(i);
    }
  }
}

// ---- Steps, and the groups of those that are generated kernels.

using Values = std::unordered_map<int, int>;  // of one group: node -> place in its code

struct Grouper : Nodes {
  void add_steps();
  void add_pointwise(int i);
  void add_reduce(int i);
  int find_group(int i) const;
  bool room(const Group& group, int i) const;
  int value_of(Group& group, Values& values, int i) const;
  Operand operand_of(Group& group, Values& values, int i) const;

  Plan plan = {};
  std::vector<Values> values_of = {};  // of each group
  std::vector<int> step_of = {};       // of each group
};

Operand Grouper::operand_of(Group& group, Values& values, int i) const {
  const auto slot = [](std::vector<GroupInput>& list, int n, DType dtype) {
    for (size_t k = 0; k < list.size(); k++)
      if (list[k].node == n) return static_cast<int>(k);
    list.push_back({n, dtype});
    return static_cast<int>(list.size()) - 1;
  };
  if (constant(i)) return {Operand::scalar, slot(group.scalars, i, node(i)->dtype)};
  if (values.contains(i) || at(i).inlined) return {Operand::value, value_of(group, values, i)};
  return {Operand::input, slot(group.inputs, i, node(i)->dtype)};
}

int Grouper::value_of(Group& group, Values& values, int i) const {
  if (const auto found = values.find(i); found != values.end()) return found->second;
  Instruction step;
  step.op = static_cast<const PointwiseOp*>(node(i)->op.get());
  step.dtype = node(i)->dtype;
  for (const Tensor& in : node(i)->in) step.operands.push_back(operand_of(group, values, in.node()->index));
  group.code.push_back(step);
  return values[i] = static_cast<int>(group.code.size()) - 1;
}

bool Grouper::room(const Group& group, int i) const {
  std::set<int> reads;
  for (const GroupInput& in : group.inputs) reads.insert(in.node);
  reads.insert(at(i).leaves.begin(), at(i).leaves.end());
  return reads.size() <= kMaxInputs && group.outputs.size() < kMaxOutputs &&
         group.scalars.size() + static_cast<size_t>(at(i).scalars) <= static_cast<size_t>(kMaxScalars) &&
         group.code.size() + static_cast<size_t>(at(i).cost) <= static_cast<size_t>(kMaxCode);
}

/// An earlier kernel over the same space that all of i's inputs precede (or that makes them itself), or -1.
int Grouper::find_group(int i) const {
  const int count = static_cast<int>(plan.groups.size());
  for (int g = count - 1; g >= std::max(0, count - kMergeWindow); g--) {
    const Group& group = plan.groups[static_cast<size_t>(g)];
    if (group.reduce || shape_id(group.shape_node) != shape_id(i)) continue;
    bool precede = true;
    for (int leaf : at(i).leaves) precede &= at(leaf).group == g || at(leaf).ready < step_of[static_cast<size_t>(g)];
    if (precede && room(group, i)) return g;
  }
  return -1;
}

void Grouper::add_pointwise(int i) {
  int g = constant(i) ? -1 : find_group(i);
  if (g < 0) {
    g = static_cast<int>(plan.groups.size());
    step_of.push_back(static_cast<int>(plan.steps.size()));
    plan.groups.emplace_back();
    plan.groups.back().shape_node = i;
    values_of.emplace_back();
    plan.steps.push_back({PlanStep::group, g, {}});
  }
  Group& group = plan.groups[static_cast<size_t>(g)];
  Values& values = values_of[static_cast<size_t>(g)];
  int value = 0;
  if (constant(i)) {
    group.code.push_back({nullptr, {operand_of(group, values, i)}, node(i)->dtype});
    value = static_cast<int>(group.code.size()) - 1;
  } else {
    value = value_of(group, values, i);
  }
  group.outputs.push_back({value, i, node(i)->dtype});
  at(i).ready = step_of[static_cast<size_t>(g)];
  at(i).group = g;
}

void Grouper::add_reduce(int i) {
  Group group;
  Values values;
  const int source = node(i)->in[0].node()->index;
  operand_of(group, values, source);
  if (constant(source)) group.code.push_back({nullptr, {{Operand::scalar, 0}}, node(source)->dtype});
  group.reduce = std::static_pointer_cast<const ReduceOp>(node(i)->op);  // plans outlive the graph they came from
  group.reduce_node = i;
  group.reduce_dtype = node(i)->dtype;
  group.shape_node = source;
  at(i).ready = static_cast<int>(plan.steps.size());
  plan.steps.push_back({PlanStep::group, static_cast<int>(plan.groups.size()), {}});
  plan.groups.push_back(group);
  values_of.push_back(values);
  step_of.push_back(at(i).ready);
}

void Grouper::add_steps() {
  for (int i = 0; i < size(); i++) {
    if (!pending(i) || at(i).inlined) continue;
    if (constant(i)) {
      bool needed = at(i).output;
      for (int user : at(i).users) needed |= kind(user) == OpKind::kernel || kind(user) == OpKind::view;
      if (needed) add_pointwise(i);
    } else if (kind(i) == OpKind::pointwise) {
      add_pointwise(i);
    } else if (kind(i) == OpKind::reduce) {
      add_reduce(i);
    } else {
      at(i).ready = static_cast<int>(plan.steps.size());
      plan.steps.push_back({kind(i) == OpKind::view ? PlanStep::view : PlanStep::kernel, i, {}});
    }
  }
}

// ---- How long values live.

struct Lifetimes : Nodes {
  void find_last_uses();
  void find_heirs();
  bool shares_buffer(int i) const;

  Plan& plan;
};

/// Counted on the launches as cut: an inlined node is used where its kernel runs.
void Lifetimes::find_last_uses() {
  std::vector<int> last(states.size(), -1);
  for (size_t s = 0; s < plan.steps.size(); s++) {
    const PlanStep& step = plan.steps[s];
    const auto use = [&](int i) { last[static_cast<size_t>(i)] = static_cast<int>(s); };
    if (step.kind == PlanStep::group) {
      const Group& group = plan.groups[static_cast<size_t>(step.index)];
      for (const GroupInput& in : group.inputs) use(in.node);
      for (const GroupOutput& out : group.outputs) use(out.node);
      if (group.reduce) use(group.reduce_node);
    } else {
      for (const Tensor& in : node(step.index)->in) use(in.node()->index);
      use(step.index);
    }
  }
  for (int i = 0; i < size(); i++)
    if (last[static_cast<size_t>(i)] >= 0 && pending(i) && !at(i).output)
      plan.steps[static_cast<size_t>(last[static_cast<size_t>(i)])].last_uses.push_back(i);
}

bool Lifetimes::shares_buffer(int i) const {
  const auto is_view = [&](int n) { return node(n)->op->kind() == OpKind::view; };
  return is_view(i) || std::ranges::any_of(at(i).users, is_view);
}

/// A pointwise result takes the buffer of an input that dies in the same launch and lies alike, unless views share that
/// buffer (and running checks again that nobody else holds it).
void Lifetimes::find_heirs() {
  for (const PlanStep& step : plan.steps) {
    if (step.kind != PlanStep::group) continue;
    Group& group = plan.groups[static_cast<size_t>(step.index)];
    std::vector<bool> taken(group.inputs.size());
    for (GroupOutput& out : group.outputs)
      for (size_t k = 0; k < group.inputs.size() && out.heir_of < 0; k++) {
        const int i = group.inputs[k].node;
        const bool alike = group.inputs[k].dtype == out.dtype && shape_id(i) == shape_id(group.shape_node);
        if (taken[k] || !alike || std::ranges::find(step.last_uses, i) == step.last_uses.end() || shares_buffer(i))
          continue;
        out.heir_of = static_cast<int>(k);
        taken[k] = true;
      }
  }
}

}  // namespace

Plan cut(const Walk& graph) {
  std::vector<State> states(graph.nodes.size());
  const Nodes nodes{graph, states};
  Inliner inliner{nodes};
  inliner.find_users();
  inliner.choose_inlined();
  inliner.limit_inputs();
  Grouper grouper{nodes};
  grouper.add_steps();
  Lifetimes lifetimes{nodes, grouper.plan};
  lifetimes.find_last_uses();
  lifetimes.find_heirs();
  grouper.plan.signature = graph.signature;
  return std::move(grouper.plan);
}

}  // namespace cloam
