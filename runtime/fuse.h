// Generated kernels: a group of pointwise steps (with several results, or ending in a reduction) becomes one kernel.
// Kernel text depends on the steps, on how many axes remain after collapsing, and on which inputs run along the inner
// axis with stride 1, 0 or other. Extents, strides and scalars are arguments: one record of 32-bit words, because
// drivers pay for every argument of every launch.
#pragma once
#include <array>
#include <span>
#include <string>
#include <vector>

#include "runtime/cl.h"
#include "runtime/ops/pointwise.h"
#include "runtime/ops/reduce.h"

namespace cloam {

struct Operand {
  enum Kind : uint8_t { value, input, scalar } kind = value;
  int index = 0;
};

struct Instruction {
  const PointwiseOp* op = nullptr;  // null: copies its operand (a constant that must lie in memory)
  std::vector<Operand> operands;
  DType dtype = DType::f32;
};

struct GroupInput {
  int node = 0;
  DType dtype = DType::f32;
};

struct GroupOutput {
  int value = 0, node = 0;
  DType dtype = DType::f32;
  int heir_of = -1;  // the input whose values nobody needs afterwards: the result may take its buffer
};

/// One kernel to be. Nodes are places in the walk, so that a plan can be reused with the nodes of a later step.
struct Group {
  std::vector<GroupInput> inputs;
  std::vector<GroupInput> scalars;
  std::vector<Instruction> code;
  std::vector<GroupOutput> outputs;        // of a pointwise group
  std::shared_ptr<const ReduceOp> reduce;  // or: the last value (else the only input) is reduced ...
  int reduce_node = -1;                    // ... into this node,
  DType reduce_dtype = DType::f32;         // summed in this type
  int shape_node = 0;                      // the node whose shape is iterated over
};

constexpr size_t kMaxInputs = 16;  // tensors one generated kernel may read
constexpr size_t kMaxOutputs = 6;  // and write
constexpr int kMaxScalars = 48;
constexpr size_t kMaxStreamed = 16;    // steps in a kernel that still waits for memory more than it computes
constexpr int64_t kStreamTile = 32;    // numbers stored past the caches together
constexpr int kReduceLanes = 64;       // partial results along a reduced inner axis: one fixed tree on every device
constexpr int kReduceColumns = 256;    // columns a CPU work-item sums side by side
constexpr int64_t kSerialReduce = 32;  // up to here one accumulator, in order

/// The iteration space after dropping axes of size 1 and joining neighbours that every input walks alike.
struct Layout {
  Shape extents;
  std::array<Shape, kMaxInputs> strides;
  size_t inputs = 0;
  uint32_t reduced = 0;   // bit i: collapsed axis i is reduced
  uint32_t in_place = 0;  // bit i: output i lies in the buffer of the input it is the heir of
  bool serial = false;
  int inner_kind(size_t input) const;  // 0: constant along the inner axis, 1: dense, 2: strided
  bool inner_reduced() const { return reduced >> (extents.rank() - 1) & 1u; }
  int64_t reduced_count() const;
  int64_t kept_count() const;
  uint64_t key() const;
};
Layout collapse(const Shape& shape, std::span<Node* const> inputs, uint32_t reduced_axes);
/// Whether the kernel has a path whose stores go past the caches (CPU devices: 1.4 times as fast on results larger than
/// the last cache; slower on anything else).
bool may_stream(const Group& group, const Layout& layout);

/// Kernel text for a group under a layout; its name is a hash of the text.
Generated generate(const Group& group, const Layout& layout);

}  // namespace cloam
