// The pointwise table: name | OpenCL C text | typing | gradients. A new pointwise op is one row here, one line in
// ops.h and one row in tests/op_cases/pointwise_cases.cpp.
#include "runtime/ops/pointwise.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

using T = const Tensor&;
using In = const Tensors&;

struct ConstantOp final : Op {
  const char* name() const override { return "constant"; }
  OpKind kind() const override { return OpKind::constant; }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
};

bool is_float(DType t) { return t == DType::f32 || t == DType::f16; }

DType common(const Tensors& in) {
  bool any_unsigned = false;
  for (T t : in) {
    if (is_float(t.dtype())) return DType::f32;
    any_unsigned |= t.dtype() == DType::u32;
  }
  return any_unsigned ? DType::u32 : DType::i32;
}

void check_whole(const PointwiseOp& row, const Tensors& in) {
  for (T t : in)
    if (is_float(t.dtype()))
      throw Error(Fault::internal, text("[", row.label, "] wants integers, found ", name_of(t.dtype())));
}

DType result_type(const PointwiseOp& row, const Tensors& in) {
  if (row.typing == Typing::same) return is_float(in[0].dtype()) ? in[0].dtype() : DType::f32;
  if (row.typing == Typing::floating) return DType::f32;
  if (row.typing == Typing::mask) return DType::i32;
  if (row.typing == Typing::whole) check_whole(row, in);
  return common(in);
}

std::shared_ptr<PointwiseOp> row(const char* id, const char* code, Typing type, PointwiseOp::Vjp vjp) {
  auto op = std::make_shared<PointwiseOp>(id, code, type, vjp);
  const Registered registered(id);
  return op;
}

Tensor apply(const std::shared_ptr<PointwiseOp>& op, Tensors in) {
  Shape shape = in[0].shape();
  for (size_t i = 1; i < in.size(); i++) shape = broadcast(op->name(), shape, in[i].shape());
  const DType dtype = result_type(*op, in);
  return make(op, shape, std::move(in), dtype);
}

constexpr auto kF = Typing::floating, kP = Typing::promote, kM = Typing::mask, kW = Typing::whole, kS = Typing::same;

}  // namespace

std::shared_ptr<const Op> constant_op() {
  static const auto op = std::make_shared<ConstantOp>();
  return op;
}

static Tensor negate(T x);

// One row: a static op object and the function that applies it. In the gradients a, b, c are the operands, y the
// result, g the gradient that arrives.
#define ROW1(fn, code, type, ...)                                         \
  static const auto row_##fn = row(#fn, code, type, [](In in, T y, T g) { \
    T a = in[0];                                                          \
    (void)a, (void)y, (void)g;                                            \
    return Tensors{__VA_ARGS__};                                          \
  });                                                                     \
  Tensor fn(T x) { return apply(row_##fn, {x}); }
#define ROW2(fn, id, code, type, ...)                                     \
  static const auto row_##id = row(#id, code, type, [](In in, T y, T g) { \
    T a = in[0];                                                          \
    T b = in[1];                                                          \
    (void)a, (void)b, (void)y, (void)g;                                   \
    return Tensors{__VA_ARGS__};                                          \
  });                                                                     \
  Tensor fn(T x, T z) { return apply(row_##id, {x, z}); }

//   op          text                              type  gradients
ROW2(operator+, add, "a + b", kP, g, g)
ROW2(operator-, subtract, "a - b", kP, g, -g)
ROW2(operator*, multiply, "a * b", kP, g* b, g* a)
ROW2(operator/, divide, "a / b", kP, g / b, -(g* y / b))
ROW2(minimum, minimum, "(a < b ? a : b)", kP, where(a < b, g, 0.f), where(a < b, 0.f, g))
ROW2(maximum, maximum, "(a > b ? a : b)", kP, where(a > b, g, 0.f), where(a > b, 0.f, g))
ROW2(pow, pow, "m_pow(a, b)", kF, g* b* pow(a, b - 1.f), g* y* log(a))
ROW2(atan2, atan2, "atan2(a, b)", kF, g* b / (a * a + b * b), -(g* a / (a * a + b * b)))
ROW2(modulo, modulo, "(a % b)", kW, Tensor(), Tensor())
ROW2(bit_xor, bit_xor, "(a ^ b)", kW, Tensor(), Tensor())
ROW2(operator<, less, "(a < b)", kM, Tensor(), Tensor())
ROW2(operator>, greater, "(a > b)", kM, Tensor(), Tensor())
ROW2(operator<=, less_equal, "(a <= b)", kM, Tensor(), Tensor())
ROW2(equal, equal, "(a == b)", kM, Tensor(), Tensor())
ROW1(negate, "-a", kP, -g)
ROW1(abs, "(a < 0 ? -a : a)", kP, where(a < 0.f, -g, g))
ROW1(sign, "((a > 0) - (a < 0))", kP, Tensor())
ROW1(floor, "floor(a)", kF, Tensor())
ROW1(square, "a * a", kP, g* a * 2.f)
ROW1(sqrt, "sqrt(a)", kF, g / y * 0.5f)
ROW1(rsqrt, "(1.0f / sqrt(a))", kF, g* y* y* y * -0.5f)
ROW1(exp, "m_exp(a)", kF, g* y)
ROW1(log, "m_log(a)", kF, g / a)
ROW1(sin, "m_sin(a)", kF, g* cos(a))
ROW1(cos, "m_cos(a)", kF, -(g* sin(a)))
ROW1(tanh, "m_tanh(a)", kF, g*(1.f - y * y))
ROW1(erf, "m_erf(a)", kF, g* exp(-(a* a)) * float(M_2_SQRTPI))
ROW1(sigmoid, "m_sigmoid(a)", kF, g* y*(1.f - y))
ROW1(softplus, "m_softplus(a)", kF, g* sigmoid(a))
ROW1(silu, "a * m_sigmoid(a)", kF, g* sigmoid(a) * (1.f + a * (1.f - sigmoid(a))))
ROW1(relu, "fmax(a, 0.0f)", kS, where(y > 0.f, g, 0.f))  // by the result: the operand need not be kept
#undef ROW1
#undef ROW2

static const auto row_where = row("where", "(a ? b : c)", kP, [](In in, T, T g) {
  return Tensors{Tensor(), where(in[0], g, 0.f), where(in[0], 0.f, g)};
});
Tensor where(T condition, T yes, T no) {
  if (is_float(condition.dtype()))
    throw Error(Fault::internal,
                text("[where] the condition has dtype ", name_of(condition.dtype()), ", want an integer mask"));
  Shape shape = broadcast("where", broadcast("where", condition.shape(), yes.shape()), no.shape());
  return make(row_where, shape, {condition, yes, no}, common({yes, no}));
}

static const auto row_cast = row("cast", "a", Typing::cast_to, [](In, T, T g) { return Tensors{g}; });
Tensor cast(T x, DType dtype) { return x.dtype() == dtype ? x : make(row_cast, x.shape(), {x}, dtype); }

static const auto row_stop = row("stop_gradient", "a", kP, [](In, T, T) { return Tensors{Tensor()}; });
Tensor stop_gradient(T x) {
  if (!x.tracked()) return x;
  Tensor out = make(row_stop, x.shape(), {x}, x.dtype());
  out.node()->tracked = false;
  return out;
}

Tensor operator-(T x) { return negate(x); }
Tensor clamp(T x, T low, T high) { return minimum(maximum(x, low), high); }
Tensor leaky_relu(T x, float slope) { return where(x > 0.f, x, x * slope); }
Tensor gelu(T x) { return x * 0.5f * (1.f + erf(x * float(M_SQRT1_2))); }

}  // namespace cloam
