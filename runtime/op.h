// What an op is: a name, a way to run, and a gradient written with ops.
// Adding one: a composition in its ops/*.cpp; a row in ops/pointwise.cpp; or a kernel op (ops/x.cpp + kernels/x.cl).
#pragma once
#include <optional>
#include <string>

#include "runtime/tensor.h"

namespace cloam {

struct Buffer;

/// Where values lie: elements of `buffer` from `offset` on, `strides` in elements. Views share the buffer.
struct Storage {
  std::shared_ptr<Buffer> buffer;
  int64_t offset = 0;
  Shape strides;
  bool dense(const Shape& shape) const;
};

enum class OpKind : uint8_t { kernel, pointwise, constant, view, reduce };

struct Op : std::enable_shared_from_this<Op> {
  virtual ~Op() = default;
  std::shared_ptr<const Op> shared() const { return shared_from_this(); }
  virtual const char* name() const = 0;  // a literal: its address takes part in the plan's key
  virtual OpKind kind() const { return OpKind::kernel; }
  /// What changes the plan beyond name, ranks and shapes' equality (reduced axes, say). Scalars are no part of it.
  virtual uint64_t key() const { return 0; }
  /// Kernel ops: launches work that fills `out` (allocated, dense). Inputs are evaluated, and dense unless
  /// strided_inputs().
  virtual void run(const Tensors& in, Tensor& out) const;
  virtual bool strided_inputs() const { return false; }
  /// View ops: where the result lies inside its input, or nothing when only a dense copy of the input has such a view.
  virtual std::optional<Storage> view(const Storage& in, const Shape& in_shape, const Shape& out_shape) const;
  /// d loss / d in, given g = d loss / d out. Written with ops; an empty Tensor where no gradient is defined.
  /// Broadcasting is undone by grad(), never here.
  virtual Tensors vjp(const Tensors& in, const Tensor& out, const Tensor& g) const = 0;
};

struct Node {
  Shape shape;
  DType dtype = DType::f32;
  std::shared_ptr<const Op> op;  // null for a leaf
  Tensors in;
  Storage storage;                // no buffer until evaluated
  std::shared_ptr<Buffer> place;  // where an output's values shall lie (flat.h), if anywhere in particular
  bool tracked = false;
  double value = 0;    // of a constant
  uint64_t visit = 0;  // walk that saw this node last, and the place it got there
  int index = 0;
  ~Node();
};

/// A new lazy node. Tracked when an input is and dtype is float.
Tensor make(std::shared_ptr<const Op> op, const Shape& shape, Tensors in, DType dtype = DType::f32);
/// An allocated leaf with unspecified contents (scratch of kernel ops).
Tensor empty(const Shape& shape, DType dtype = DType::f32);
/// `tensor` evaluated and dense: itself, or a packed copy.
Tensor dense(const Tensor& tensor);
/// Makes the result of an op, while it runs, what other ops gave.
void adopt(Tensor& out, const Tensor& value);
/// Copies an evaluated tensor, however it lies, into the dense memory of `to`, of its shape and type.
void pack(const Tensor& tensor, const Tensor& to);
/// Every kernel op says its name once, `static const Registered registered("matmul");` beside its code: an op without a
/// row in tests/op_cases fails the suite.
struct Registered {
  explicit Registered(const char* name);
};
const std::vector<std::string>& registered_ops();

}  // namespace cloam
