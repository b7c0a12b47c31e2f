// A plan: the launches that evaluate a graph of one structure. It is found by the walk's signature, so a training step
// searches no graph after its structure was seen once. Extents and scalars are read from the nodes at hand.
#pragma once
#include <vector>

#include "runtime/fuse.h"

namespace cloam {

/// The pending graph in an order in which inputs come first, and the words that identify its structure.
struct Walk {
  std::vector<Node*> nodes;
  std::vector<int> shape_ids;  // equal ids: equal shapes
  std::vector<int> outputs;
  std::vector<uint64_t> signature;
  uint64_t hash = 0;  // of the signature
};
/// Fills `out` anew, in the memory it already has. Outputs with values are passed over.
void walk(const Tensors& outputs, Walk& out);

struct PlanStep {
  enum Kind : uint8_t { group, kernel, view } kind = group;
  int index = 0;                                               // of the group, or of the node
  std::vector<int> last_uses;                                  // nodes whose values nobody needs after this step
  std::vector<std::pair<uint64_t, cl::Kernel*>> kernels = {};  // by layout key: seldom more than one
};

struct Plan {
  std::vector<uint64_t> signature;
  std::vector<Group> groups;
  std::vector<PlanStep> steps;
};
/// Cuts the graph into launches: which pointwise nodes are written into their users' kernels, which lie in memory.
Plan cut(const Walk& walk);

/// Runs one group with the nodes of `walk` (plan execution), finding or compiling its kernel.
void run_group(const Group& group, PlanStep& step, const Walk& walk);

}  // namespace cloam
