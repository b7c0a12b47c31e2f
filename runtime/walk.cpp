// The pending graph as a list, inputs first, and what identifies its structure.
#include "runtime/plan.h"

namespace cloam {
namespace {

uint64_t mix(uint64_t hash, uint64_t value) { return (hash ^ value) * 0x9E3779B97F4A7C15ull + (hash >> 29); }

uint64_t hash_of(const Shape& shape) {
  uint64_t hash = static_cast<uint64_t>(shape.rank()) + 77;
  for (int64_t size : shape) hash = mix(hash, static_cast<uint64_t>(size));
  return hash;
}

/// Shapes numbered in order of first appearance. Open addressing, cleared by stamping: no allocation per walk.
class ShapeNumbers {
 public:
  void begin() {
    stamp_++;
    count_ = 0;
  }
  int of(const Shape& shape) {
    const uint64_t hash = hash_of(shape);
    for (size_t slot = hash & (kSlots - 1);; slot = (slot + 1) & (kSlots - 1)) {
      Entry& entry = entries_[slot];
      if (entry.stamp != stamp_) {
        entry = {stamp_, hash, count_};
        return count_++;
      }
      if (entry.hash == hash) return entry.id;
    }
  }

 private:
  static constexpr size_t kSlots = 8192;
  struct Entry {
    uint64_t stamp = 0, hash = 0;
    int id = 0;
  };
  std::vector<Entry> entries_ = std::vector<Entry>(kSlots);
  uint64_t stamp_ = 0;
  int count_ = 0;
};

bool leaf(const Node* node) { return node->storage.buffer || !node->op; }

void record(Walk& out, Node* node, ShapeNumbers& shapes) {
  node->index = static_cast<int>(out.nodes.size());
  out.nodes.push_back(node);
  const int shape_id = shapes.of(node->shape);
  out.shape_ids.push_back(shape_id);
  uint64_t word = mix(static_cast<uint64_t>(node->dtype) << 8 | static_cast<uint64_t>(node->shape.rank()),
                      static_cast<uint64_t>(shape_id));
  if (leaf(node)) {
    word = mix(word, node->storage.dense(node->shape) ? 2 : 3);
  } else {
    word = mix(mix(word, reinterpret_cast<uintptr_t>(node->op->name())), node->op->key());
    for (const Tensor& in : node->in) word = mix(word, static_cast<uint64_t>(in.node()->index));
  }
  out.signature.push_back(word);
}

}  // namespace

void walk(const Tensors& outputs, Walk& out) {
  static uint64_t visit = 0;
  static ShapeNumbers shapes;
  static std::vector<std::pair<Node*, size_t>> stack;
  out.nodes.clear();
  out.shape_ids.clear();
  out.outputs.clear();
  out.signature.clear();
  stack.clear();  // a walk may have ended by an exception
  visit++;
  shapes.begin();
  for (const Tensor& output : outputs) {
    if (output.evaluated()) continue;
    if (output.node()->visit != visit) {
      output.node()->visit = visit;
      stack.push_back({output.node(), 0});
    }
    while (!stack.empty()) {
      auto& [node, next] = stack.back();
      if (leaf(node) || next == node->in.size()) {
        record(out, node, shapes);
        stack.pop_back();
        continue;
      }
      Node* input = node->in[next++].node();
      if (input->visit == visit) continue;
      input->visit = visit;
      stack.push_back({input, 0});
    }
    out.outputs.push_back(output.node()->index);
  }
  for (int i : out.outputs) out.signature.push_back(static_cast<uint64_t>(i));
  out.hash = 0;
  for (uint64_t word : out.signature) out.hash = mix(out.hash, word);
}

}  // namespace cloam
