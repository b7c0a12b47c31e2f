// eval(): walk the pending graph, find its plan (or cut a new one), run the launches.
#include "runtime/plan.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <list>
#include <unordered_map>

#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/profile.h"

namespace cloam {
namespace {

Node* at(const Walk& graph, int i) { return graph.nodes[static_cast<size_t>(i)]; }

void allocate_for(Node* node) {
  std::shared_ptr<Buffer> buffer = std::move(node->place);
  if (!buffer) buffer = allocate(static_cast<size_t>(numel(node->shape)) * size_of(node->dtype));
  node->storage = {std::move(buffer), 0, dense_strides(node->shape)};
}

Tensor handle(const Walk& graph, int i) {
  for (Node* node = at(graph, i); node;) return Tensor(std::shared_ptr<Node>(std::shared_ptr<Node>(), node));
  return {};
}

/// The heir's buffer is free to be written when nothing but the dying node holds it; before anything ran (compile())
/// there is none, and results are promised to lie dense.
bool heir_may_move_in(const GroupOutput& out, const Group& group, const Walk& graph) {
  if (out.heir_of < 0 || at(graph, out.node)->place) return false;
  const Node* node = at(graph, group.inputs[static_cast<size_t>(out.heir_of)].node);
  return node->storage.buffer.use_count() <= 1 && node->storage.dense(node->shape);
}

Layout layout_of(const Group& group, const Walk& graph) {
  std::array<Node*, kMaxInputs> inputs;
  for (size_t i = 0; i < group.inputs.size(); i++) inputs[i] = at(graph, group.inputs[i].node);
  Layout layout = collapse(at(graph, group.shape_node)->shape, {inputs.data(), group.inputs.size()},
                           group.reduce ? group.reduce->axes : 0);
  for (size_t j = 0; j < group.outputs.size(); j++)
    if (heir_may_move_in(group.outputs[j], group, graph)) layout.in_place |= 1u << j;
  return layout;
}

cl::Kernel& kernel_of(const Group& group, const Layout& layout, PlanStep& step) {
  const uint64_t key = layout.key();
  for (const auto& [known, found] : step.kernels)
    if (known == key) return *found;
  step.kernels.push_back({key, &generated_kernel(generate(group, layout))});
  return *step.kernels.back().second;
}

/// Whether an output has taken the buffer of this input: then it is no argument of its own.
bool replaced(size_t input, const Group& group, const Layout& layout) {
  for (size_t j = 0; j < group.outputs.size(); j++)
    if ((layout.in_place >> j & 1u) && group.outputs[j].heir_of == static_cast<int>(input)) return true;
  return false;
}

void add_scalar(Words& words, DType dtype, double value) {
  if (dtype == DType::f32)
    words.add_bits(std::bit_cast<uint32_t>(static_cast<float>(value)));
  else
    words.add(static_cast<int64_t>(value));
}

/// The words in fuse.cpp's order, then the memory of inputs and results.
void add_arguments(Arguments& arguments, const Group& group, const Layout& layout, const Walk& graph,
                   std::initializer_list<int64_t> more_words) {
  Words words;
  for (size_t i = 0; i < group.inputs.size(); i++) {
    if (replaced(i, group, layout)) continue;
    words.add(at(graph, group.inputs[i].node)->storage.offset);
    for (int axis = 0; axis + 1 < layout.extents.rank(); axis++) words.add(layout.strides[i][axis]);
    if (layout.inner_kind(i) == 2) words.add(layout.strides[i].back());
  }
  for (const GroupInput& scalar : group.scalars) add_scalar(words, scalar.dtype, at(graph, scalar.node)->value);
  for (int64_t extent : layout.extents) words.add(extent);
  for (int64_t value : more_words) words.add(value);
  arguments.add(words);
  for (size_t i = 0; i < group.inputs.size(); i++)
    if (!replaced(i, group, layout)) arguments.add_memory(handle(graph, group.inputs[i].node));
}

/// Without an op it moves what lies otherwise (a permuted view that a kernel needs dense), or writes a constant.
const char* label(const Group& group, const Instruction& of) {
  return of.op ? of.op->label : group.inputs.empty() ? "fill" : "copy";
}

const char* label(const Group& group) { return group.reduce ? group.reduce->name() : label(group, group.code.back()); }

/// Stores that go past the caches pay where the results are larger than the last cache, and lie at multiples of 64
/// bytes.
bool streams(const Group& group, const Layout& layout, int64_t elements) {
  const auto bytes = static_cast<uint64_t>(elements) * 4 * group.outputs.size();
  return bytes > device().cache_bytes && may_stream(group, layout) &&
         (layout.extents.rank() == 1 || layout.extents.back() % 16 == 0);
}

/// How the elements of a pointwise group are shared out: `chunk` along the inner axis, `rows_each` of the rest.
struct Tiling {
  Range range;
  int64_t chunk = 1, rows_each = 1;
};

Tiling tiling_of(int64_t rows, int64_t inner) {
  Tiling out;
  if (is_cpu_class()) {
    // About 64 work-items, none below 4,096 elements: a group costs 4 ns, a launch 1.4 us.
    const int64_t share = std::clamp<int64_t>(rows * inner / 64, 4096, 1 << 18) / kStreamTile * kStreamTile;
    out.chunk = std::min(inner, share);
    out.rows_each = std::max<int64_t>(1, share / inner);
    out.range = range2((inner + out.chunk - 1) / out.chunk, (rows + out.rows_each - 1) / out.rows_each);
  } else {
    out.range = range1(std::min<int64_t>(inner, 1 << 20), 64);
    out.range.global[1] = static_cast<size_t>(std::min<int64_t>(rows, 32768));
    out.rows_each = (rows + static_cast<int64_t>(out.range.global[1]) - 1) / static_cast<int64_t>(out.range.global[1]);
  }
  return out;
}

void run_pointwise(const Group& group, PlanStep& step, const Walk& graph) {
  const Layout layout = layout_of(group, graph);
  const int64_t inner = layout.extents.back();
  int64_t rows = 1;
  for (int i = 0; i + 1 < layout.extents.rank(); i++) rows *= layout.extents[i];
  for (size_t j = 0; j < group.outputs.size(); j++) {
    const GroupOutput& out = group.outputs[j];
    if (layout.in_place >> j & 1u)
      at(graph, out.node)->storage = at(graph, group.inputs[static_cast<size_t>(out.heir_of)].node)->storage;
    else
      allocate_for(at(graph, out.node));
  }
  if (rows * inner == 0) return;

  const Tiling tiling = tiling_of(rows, inner);
  cl::Kernel& found = kernel_of(group, layout, step);
  Arguments arguments(found);
  add_arguments(arguments, group, layout, graph,
                {tiling.chunk, tiling.rows_each, streams(group, layout, rows * inner) ? 1 : 0});
  for (const GroupOutput& out : group.outputs) arguments.add(handle(graph, out.node));
  enqueue(found, label(group), tiling.range, arguments.bytes());
}

/// How a reduction is shared out: work-items over kept indices, and chunks of the reduced ones whose partial results
/// are reduced again. A function of the extents and the device class alone, so the order of summation is fixed.
struct Split {
  int64_t items, per_item, chunks, length;
};

Split split_reduction(const Layout& layout) {
  const bool cpu = is_cpu_class();
  const int64_t kept = layout.kept_count(), reduced = layout.reduced_count();
  Split s{};
  if (layout.inner_reduced()) {
    s.per_item = cpu ? std::max<int64_t>(1, std::min<int64_t>(kept / 64, 4096)) : 1;
    s.items = (kept + s.per_item - 1) / s.per_item;
  } else {
    const int64_t inner = layout.extents.back();
    s.per_item = cpu ? std::min<int64_t>(inner, kReduceColumns) : 1;
    s.items = kept / inner * ((inner + s.per_item - 1) / s.per_item);
  }
  const int64_t wanted = cpu ? 64 : 4096, least = cpu ? 4096 : 256, most = cpu ? 64 : 1024;
  const int64_t work = std::max<int64_t>(1, reduced * std::min<int64_t>(s.per_item, kReduceColumns));
  s.chunks = std::clamp<int64_t>(std::min(wanted / std::max<int64_t>(1, s.items), work / least), 1, most);
  s.length = std::max<int64_t>(1, (reduced + s.chunks - 1) / s.chunks);
  s.chunks = std::max<int64_t>(1, (reduced + s.length - 1) / s.length);
  return s;
}

void launch_reduce(const Group& group, PlanStep& step, const Walk& graph, const Layout& layout, const Split& split,
                   const Tensor& to) {
  Arguments arguments(kernel_of(group, layout, step));
  add_arguments(arguments, group, layout, graph, {layout.kept_count(), split.per_item, split.length});
  arguments.add(to);
  Range range = range1(split.items, is_cpu_class() ? 1 : 64);
  range.global[1] = static_cast<size_t>(split.chunks);
  enqueue(kernel_of(group, layout, step), label(group), range, arguments.bytes());
}

/// [chunks, kept] -> [kept]: the same generated reduction with nothing before it.
void reduce_partials(const Group& group, const Tensor& partial, const Tensor& to) {
  static std::unordered_map<uint64_t, PlanStep> steps;
  static const std::shared_ptr<const ReduceOp> over_rows[] = {std::make_shared<ReduceOp>(Reduction::sum, 1),
                                                              std::make_shared<ReduceOp>(Reduction::max, 1),
                                                              std::make_shared<ReduceOp>(Reduction::min, 1)};
  Group second;
  second.inputs = {{0, group.reduce_dtype}};
  second.reduce = over_rows[static_cast<size_t>(group.reduce->reduction)];
  second.reduce_dtype = group.reduce_dtype;
  Walk graph;
  graph.nodes = {partial.node()};
  const Layout layout = layout_of(second, graph);
  PlanStep& step =
      steps[static_cast<uint64_t>(group.reduce->reduction) << 8 | static_cast<uint64_t>(group.reduce_dtype)];
  Split split = split_reduction(layout);
  split.chunks = 1;
  split.length = layout.reduced_count();
  launch_reduce(second, step, graph, layout, split, to);
}

void run_reduce(const Group& group, PlanStep& step, const Walk& graph) {
  const Layout layout = layout_of(group, graph);
  Node* out = at(graph, group.reduce_node);
  allocate_for(out);
  if (numel(out->shape) == 0) return;
  const Split split = split_reduction(layout);
  const Tensor target = handle(graph, group.reduce_node);
  if (split.chunks == 1) return launch_reduce(group, step, graph, layout, split, target);
  const Tensor partial = empty({split.chunks, layout.kept_count()}, group.reduce_dtype);
  launch_reduce(group, step, graph, layout, split, partial);
  reduce_partials(group, partial, target);
}

void run_kernel(Node* node) {
  Tensors in = node->in;
  if (!node->op->strided_inputs())
    for (Tensor& t : in) t = dense(t);
  allocate_for(node);
  Tensor out(std::shared_ptr<Node>(std::shared_ptr<Node>(), node));
  if (out.numel() > 0) node->op->run(in, out);
}

void run_view(Node* node) {
  const Tensor& base = node->in[0];
  std::optional<Storage> view = node->op->view(base.node()->storage, base.shape(), node->shape);
  if (!view) view = node->op->view(dense(base).node()->storage, base.shape(), node->shape);
  if (!view)
    throw Error(Fault::internal, text("[", node->op->name(), "] has no view of a dense ", to_string(base.shape())));
  node->storage = *view;
}

std::string describe(const PlanStep& step, const Plan& plan, const Walk& graph) {
  if (step.kind != PlanStep::group) return at(graph, step.index)->op->name();
  std::string names;
  const Group& group = plan.groups[static_cast<size_t>(step.index)];
  for (const Instruction& i : group.code) names += std::string(names.empty() ? "" : " ") + label(group, i);
  return group.reduce ? names + " " + group.reduce->name() : names;
}

/// The nodes that a step gives values.
std::vector<int> results_of(const PlanStep& step, const Plan& plan) {
  if (step.kind != PlanStep::group) return {step.index};
  std::vector<int> results;
  const Group& group = plan.groups[static_cast<size_t>(step.index)];
  for (const GroupOutput& out : group.outputs) results.push_back(out.node);
  if (group.reduce) results.push_back(group.reduce_node);
  return results;
}

void check_finite(const PlanStep& step, const Plan& plan, const Walk& graph) {
  for (int i : results_of(step, plan)) {
    Node* node = at(graph, i);
    const bool is_float = node->dtype == DType::f32 || node->dtype == DType::f16;
    if (!is_float || step.kind == PlanStep::view) continue;
    const std::vector<float> values = handle(graph, i).to_host();
    for (size_t k = 0; k < values.size(); k++)
      if (std::isnan(values[k]) || (debug().nan && std::isinf(values[k])))
        throw Error(Fault::diverged, text("first non-finite value: ", values[k], " at element ", k, " of ",
                                          to_string(node->shape), ", made by [", describe(step, plan, graph), "]"));
  }
}

/// Layouts are known before anything ran (leaves as they lie, results dense), so all kernels of a new plan are
/// compiled as one program: a program costs 100 ms cold, a kernel in it much less.
void compile(const Plan& plan, const Walk& graph) {
  std::vector<Storage> kept;
  std::vector<Generated> texts;
  for (Node* node : graph.nodes) {
    kept.push_back(node->storage);
    if (!node->storage.buffer) node->storage.strides = dense_strides(node->shape);
  }
  for (const PlanStep& step : plan.steps) {
    if (step.kind == PlanStep::view) {
      Node* node = at(graph, step.index);
      const Tensor& base = node->in[0];
      if (auto view = node->op->view(base.node()->storage, base.shape(), node->shape))
        node->storage.strides = view->strides, node->storage.offset = view->offset;
    }
    if (step.kind != PlanStep::group) continue;
    const Group& group = plan.groups[static_cast<size_t>(step.index)];
    texts.push_back(generate(group, layout_of(group, graph)));
  }
  for (size_t i = 0; i < kept.size(); i++) graph.nodes[i]->storage = kept[i];
  build_generated(texts);
}

/// The plans of the last structures. Where shapes come from data, extents that are equal by chance make ever new
/// structures; one of a thousand nodes takes 100 KB.
class Plans {
 public:
  /// None: not seen, or too long ago.
  std::shared_ptr<Plan> find(const Walk& graph) {
    const auto [begin, end] = by_hash_.equal_range(graph.hash);
    for (auto at = begin; at != end; ++at) {
      if ((*at->second)->signature != graph.signature) continue;
      by_use_.splice(by_use_.begin(), by_use_, at->second);
      return by_use_.front();
    }
    return nullptr;
  }
  void add(uint64_t hash, const std::shared_ptr<Plan>& plan) {
    by_use_.push_front(plan);
    by_hash_.emplace(hash, by_use_.begin());
    if (by_use_.size() <= kMost) return;
    std::erase_if(by_hash_, [&](const auto& item) { return item.second == std::prev(by_use_.end()); });
    by_use_.pop_back();
  }

 private:
  static constexpr size_t kMost = 128;
  using Order = std::list<std::shared_ptr<Plan>>;
  Order by_use_;  // the last used first
  std::unordered_multimap<uint64_t, Order::iterator> by_hash_;
};

/// Shared: what the plan evaluates while it runs may push it out.
std::shared_ptr<Plan> plan_for(const Walk& graph) {
  static Plans plans;
  if (auto plan = plans.find(graph)) {
    device_stats().plans_reused++;
    if (debug().kernels) std::fprintf(stderr, "[plan] reused: %zu steps\n", plan->steps.size());
    return plan;
  }
  auto plan = std::make_shared<Plan>(cut(graph));
  device_stats().plans_built++;
  compile(*plan, graph);
  if (debug().kernels)
    std::fprintf(stderr, "[plan] new: %zu nodes, %zu steps\n", graph.nodes.size(), plan->steps.size());
  plans.add(graph.hash, plan);
  return plan;
}

void run_step(PlanStep& step, const Plan& plan, const Walk& graph) {
  if (step.kind == PlanStep::group)
    run_group(plan.groups[static_cast<size_t>(step.index)], step, graph);
  else if (step.kind == PlanStep::kernel)
    run_kernel(at(graph, step.index));
  else
    run_view(at(graph, step.index));
  if (debug().nan || looking_for_nan()) check_finite(step, plan, graph);
  for (int i : step.last_uses) at(graph, i)->storage = {};
}

/// After a fault all that the plan makes is pending again: some of it lies in memory that was never written.
void forget_results(const Plan& plan, const Walk& graph) {
  for (const PlanStep& step : plan.steps)
    for (int i : results_of(step, plan)) at(graph, i)->storage = {};
}

void run(Plan& plan, const Walk& graph) {
  try {
    for (PlanStep& step : plan.steps) run_step(step, plan, graph);
  } catch (...) {
    forget_results(plan, graph);
    throw;
  }
}

}  // namespace

void run_group(const Group& group, PlanStep& step, const Walk& graph) {
  if (group.reduce)
    run_reduce(group, step, graph);
  else
    run_pointwise(group, step, graph);
}

namespace {

/// A walk's memory is used again by later ones; running a plan may evaluate other graphs, which take another.
class WalkLoan {
 public:
  WalkLoan() {
    if (spare().empty()) spare().push_back(std::make_unique<Walk>());
    walk_ = std::move(spare().back());
    spare().pop_back();
  }
  ~WalkLoan() { spare().push_back(std::move(walk_)); }
  WalkLoan(const WalkLoan&) = delete;
  WalkLoan& operator=(const WalkLoan&) = delete;
  Walk& operator*() const { return *walk_; }

 private:
  static std::vector<std::unique_ptr<Walk>>& spare() {
    static std::vector<std::unique_ptr<Walk>> walks;
    return walks;
  }
  std::unique_ptr<Walk> walk_;
};

bool pending(const Tensor& tensor) { return !tensor.evaluated(); }

}  // namespace

void eval(const Tensors& outputs) {
  const DeviceLock lock;
  if (std::none_of(outputs.begin(), outputs.end(), pending)) return;
  const HostSpan span("eval");
  const WalkLoan loan;
  Walk& graph = *loan;
  walk(outputs, graph);
  run(*plan_for(graph), graph);
  for (const Tensor& t : outputs)
    if (!t.tracked()) {  // history that no gradient can use
      t.node()->in.clear();
      t.node()->op.reset();
    }
}

/// A pointwise identity packs any strides; built as a plan of one group, so that it also serves inside another plan.
void pack(const Tensor& tensor, const Tensor& to) {
  const DeviceLock lock;
  static std::unordered_map<int, PlanStep> steps;
  Group group;
  group.inputs = {{0, tensor.dtype()}};
  group.code = {{nullptr, {{Operand::input, 0}}, tensor.dtype()}};
  group.outputs = {{0, 1, tensor.dtype()}};
  to.node()->place = to.node()->storage.buffer;
  Walk graph;
  graph.nodes = {tensor.node(), to.node()};
  run_group(group, steps[static_cast<int>(tensor.dtype())], graph);
}

void adopt(Tensor& out, const Tensor& value) { out.node()->storage = dense(value).node()->storage; }

Tensor dense(const Tensor& tensor) {
  const DeviceLock lock;
  eval({tensor});
  if (tensor.node()->storage.dense(tensor.shape())) return tensor;
  const Tensor out = empty(tensor.shape(), tensor.dtype());
  pack(tensor, out);
  return out;
}

}  // namespace cloam
