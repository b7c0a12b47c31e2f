// A Tensor is a handle on a node of a lazy graph. Work happens at eval(), item() and to_host().
// Start reading here, then op.h (what an op is), plan.cpp (how a graph becomes launches), fuse.cpp (generated kernels).
#pragma once
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "runtime/shape.h"

namespace cloam {

enum class DType : uint8_t { f32, i32, u32, u8, f16 };
size_t size_of(DType dtype);
const char* name_of(DType dtype);

struct Node;
struct Op;

/// Cheap to copy; two copies are one node. Values are immutable except through assign() and the optimiser's in-place
/// step.
class Tensor {
 public:
  Tensor() = default;
  Tensor(float value);   // a scalar constant: a kernel argument, never kernel text
  Tensor(double value);  // the same, as float32
  Tensor(int value);     // int32
  explicit Tensor(std::shared_ptr<Node> node) : node_(std::move(node)) {}

  const Shape& shape() const;
  int rank() const { return shape().rank(); }
  int64_t dim(int axis) const;  // negative axes count from the back
  int64_t numel() const { return cloam::numel(shape()); }
  DType dtype() const;
  bool tracked() const;  // a gradient can flow through it
  bool evaluated() const;

  /// Evaluates and copies to the host, row-major. T must fit the dtype (float for f32 and f16,
  /// double for f32: with CLOAM_DEBUG=float64 its digits are those of the device).
  template <class T = float>
  std::vector<T> to_host() const;
  /// The single value of a tensor with one element.
  float item() const;

  Node* node() const { return node_.get(); }
  const std::shared_ptr<Node>& ref() const { return node_; }
  explicit operator bool() const { return node_ != nullptr; }

 private:
  std::shared_ptr<Node> node_;
};
using Tensors = std::vector<Tensor>;

/// Copies host values to the device. Throws when the count does not fill the shape.
Tensor from_host(const std::vector<float>& values, const Shape& shape);
Tensor from_host(const std::vector<int32_t>& values, const Shape& shape);
Tensor from_host(const std::vector<uint32_t>& values, const Shape& shape);
Tensor from_host(const std::vector<uint8_t>& values, const Shape& shape);
Tensor from_bytes(const void* bytes, DType dtype, const Shape& shape);
/// A leaf that gradients reach. Its storage is its own: assign() and adam() change it for every handle.
Tensor parameter(const std::vector<float>& values, const Shape& shape);

/// Evaluates all outputs together (one plan). Intermediate results that nobody asked for are not kept.
void eval(const Tensors& outputs);
/// The same, but keeps what kernel ops computed on the way, as far as a gradient of the outputs reaches: a later
/// evaluation of that gradient need not compute it again. Costs the memory of it all.
void eval_for_gradient(const Tensors& outputs);
/// Evaluates every value, then moves it into its target: all handles on the target see the change.
void assign(const std::vector<std::pair<Tensor, Tensor>>& updates);
/// d loss / d wrt, lazily, written with ops (so it can be differentiated again). The loss must have one element.
Tensors grad(const Tensor& loss, const Tensors& wrt);
/// The same with an empty handle where the loss does not depend on a tensor, instead of zeros that cost memory.
Tensors grad_where_reached(const Tensor& loss, const Tensors& wrt);
/// As grad, for any tensor, given d loss / d out, of the shape of out.
Tensors grad(const Tensor& out, const Tensors& wrt, const Tensor& g);
/// Waits until all launched work is done.
void synchronize();

}  // namespace cloam
