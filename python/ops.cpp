// The ops of runtime/ops.h under their names there, as functions and as Python's operators.
#include "runtime/ops.h"

#include <algorithm>
#include <cmath>

#include "python/bindings.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Unary = Tensor (*)(const Tensor&);
using Binary = Tensor (*)(const Tensor&, const Tensor&);
using Tensorlike = py::object;  // a tensor, a number or an array

std::vector<int> axes_from(const py::object& axis) {
  if (axis.is_none()) return {};
  if (is_whole(axis)) return {option_as<int>("axis", axis)};
  return option_as<std::vector<int>>("axis", axis);
}

Shape shape_of(const std::vector<int64_t>& sizes) {
  if (sizes.size() > kMaxRank)
    throw Error(Fault::usage, text(sizes.size(), " axes, tensors have ", kMaxRank, " at most"));
  Shape shape;
  for (const int64_t size : sizes) shape.push_back(size);
  return shape;
}

/// Along one axis of x: what x[begin:end:step] or x[place] leaves; a place takes the axis away.
Tensor indexed(const Tensor& x, int axis, const py::handle& index) {
  const auto size = static_cast<size_t>(x.dim(axis));
  if (py::isinstance<py::slice>(index)) {
    py::ssize_t begin = 0, end = 0, step = 0, count = 0;
    if (!index.cast<py::slice>().compute(static_cast<py::ssize_t>(size), &begin, &end, &step, &count))
      throw py::error_already_set();
    if (step < 1) throw Error(Fault::usage, text("a slice goes by ", step, ": want steps of 1 or more"));
    return slice(x, axis, begin, std::max(begin, end), step);
  }
  if (!is_whole(index))
    throw Error(Fault::usage, "tensors are indexed by whole numbers and slices; gather_rows() takes a tensor of rows");
  auto place = index.cast<int64_t>();
  if (place < 0) place += x.dim(axis);
  if (place < 0 || place >= x.dim(axis))
    throw py::index_error(text("place ", index.cast<int64_t>(), " of an axis of ", x.dim(axis)));
  Shape rest;
  for (int i = 0; i < x.rank(); ++i)
    if (i != axis) rest.push_back(x.dim(i));
  return reshape(slice(x, axis, place, place + 1), rest);
}

Tensor item_of(const Tensor& x, const py::object& index) {
  const py::tuple all = py::isinstance<py::tuple>(index) ? py::tuple(index) : py::make_tuple(index);
  const auto is_rest = [](const py::handle& part) { return part.ptr() == Py_Ellipsis; };
  const auto named = static_cast<int>(std::count_if(all.begin(), all.end(), [&](auto part) { return !is_rest(part); }));
  if (named > x.rank()) throw py::index_error(text(named, " places for ", x.rank(), " axes"));
  Tensor out = x;
  int axis = 0;
  for (const py::handle part : all) {
    if (is_rest(part)) {
      axis += x.rank() - named;
      continue;
    }
    const int before = out.rank();
    out = indexed(out, axis, part);
    if (out.rank() == before) ++axis;
  }
  return out;
}

/// By products: numbers below 0 have such powers, too.
Tensor whole_power(const Tensor& x, int64_t exponent) {
  if (exponent < 0) return 1.f / whole_power(cast(x, DType::f32), -exponent);
  if (exponent == 0) return cast(ones(x.shape()), x.dtype());
  if (exponent == 1) return x;
  const Tensor even = square(whole_power(x, exponent / 2));
  return exponent % 2 == 0 ? even : even * x;
}

Tensor power(const Tensor& x, const Tensorlike& exponent) {
  if (is_whole(exponent) || py::hasattr(exponent, "is_integer")) {  // a number
    const auto value = exponent.cast<double>();
    if (std::trunc(value) == value && std::abs(value) < 0x1p31) return whole_power(x, static_cast<int64_t>(value));
  }
  return pow(x, tensor_from(exponent));
}

/// As Python divides whole numbers.
Tensor quotient(const Tensor& a, const Tensor& b) {
  const auto is_float = [](const Tensor& x) { return x.dtype() == DType::f32 || x.dtype() == DType::f16; };
  return is_float(a) || is_float(b) ? a / b : cast(a, DType::f32) / b;
}

/// name(a, b) and the operators, of which the reflected one has its operands the other way round.
void add_operator(TensorClass& tensor, const char* name, const char* reflected, Binary op) {
  tensor.def(name, [op](const Tensor& a, const Tensorlike& b) { return op(a, tensor_from(b)); });
  if (reflected) tensor.def(reflected, [op](const Tensor& b, const Tensorlike& a) { return op(tensor_from(a), b); });
}

/// By element where both are numbers; Python's answer where b is none. Tensors are hashed by what they are.
void add_equality(TensorClass& tensor) {
  tensor.attr("__hash__") = py::module_::import("builtins").attr("object").attr("__hash__");
  const auto add = [&](const char* name, Binary op) {
    tensor.def(name, [op](const Tensor& a, const Tensorlike& b) {
      const bool numbers = is_whole(b) || py::isinstance<py::float_>(b) || py::hasattr(b, "__array__");
      return numbers ? py::cast(op(a, tensor_from(b))) : py::reinterpret_borrow<py::object>(Py_NotImplemented);
    });
  };
  add("__eq__", &equal);
  add("__ne__", [](const Tensor& a, const Tensor& b) { return equal(equal(a, b), 0); });
}

void add_operators(TensorClass& tensor) {
  add_operator(tensor, "__add__", "__radd__", [](const Tensor& a, const Tensor& b) { return a + b; });
  add_operator(tensor, "__sub__", "__rsub__", [](const Tensor& a, const Tensor& b) { return a - b; });
  add_operator(tensor, "__mul__", "__rmul__", [](const Tensor& a, const Tensor& b) { return a * b; });
  add_operator(tensor, "__truediv__", "__rtruediv__", &quotient);
  add_operator(tensor, "__matmul__", "__rmatmul__", &matmul);
  tensor.def("__pow__", &power);
  tensor.def("__rpow__", [](const Tensor& exponent, const Tensorlike& x) { return pow(tensor_from(x), exponent); });
  add_operator(tensor, "__mod__", "__rmod__", &modulo);
  add_operator(tensor, "__lt__", nullptr, [](const Tensor& a, const Tensor& b) { return a < b; });
  add_operator(tensor, "__gt__", nullptr, [](const Tensor& a, const Tensor& b) { return a > b; });
  add_operator(tensor, "__le__", nullptr, [](const Tensor& a, const Tensor& b) { return a <= b; });
  add_operator(tensor, "__ge__", nullptr, [](const Tensor& a, const Tensor& b) { return b <= a; });
  add_equality(tensor);
  tensor.def("__neg__", [](const Tensor& x) { return -x; });
  tensor.def("__getitem__", &item_of);
  tensor.def_property_readonly("T", [](const Tensor& x) { return transpose(x); });
  tensor.def("reshape", [](const Tensor& x, const py::args& sizes) {
    const bool one = sizes.size() == 1 && !is_whole(sizes[0]);
    return reshape(x, shape_of((one ? py::object(sizes[0]) : py::object(sizes)).cast<std::vector<int64_t>>()));
  });
  tensor.attr("__array_ufunc__") = py::none();  // array + tensor is ours
}

void add_pointwise(py::module_& module) {
  const std::pair<const char*, Unary> of_one[] = {
      {"abs", &abs},         {"sign", &sign},         {"floor", &floor},
      {"square", &square},   {"sqrt", &sqrt},         {"rsqrt", &rsqrt},
      {"exp", &exp},         {"log", &log},           {"sin", &sin},
      {"cos", &cos},         {"tanh", &tanh},         {"erf", &erf},
      {"sigmoid", &sigmoid}, {"softplus", &softplus}, {"silu", &silu},
      {"relu", &relu},       {"gelu", &gelu},         {"stop_gradient", &stop_gradient}};
  for (const auto& [name, op] : of_one)
    module.def(
        name, [op = op](const Tensorlike& x) { return op(tensor_from(x)); }, py::arg("x"));
  const std::pair<const char*, Binary> of_two[] = {{"minimum", &minimum}, {"maximum", &maximum}, {"pow", &pow},
                                                   {"atan2", &atan2},     {"equal", &equal},     {"bit_xor", &bit_xor},
                                                   {"matmul", &matmul}};
  for (const auto& [name, op] : of_two)
    module.def(
        name, [op = op](const Tensorlike& a, const Tensorlike& b) { return op(tensor_from(a), tensor_from(b)); },
        py::arg("a"), py::arg("b"));
  module.def("leaky_relu", &leaky_relu, py::arg("x"), py::arg("slope"));
  module.def(
      "clamp",
      [](const Tensor& x, const Tensorlike& low, const Tensorlike& high) {
        return clamp(x, tensor_from(low), tensor_from(high));
      },
      py::arg("x"), py::arg("low"), py::arg("high"));
  module.def(
      "where",
      [](const Tensor& condition, const Tensorlike& yes, const Tensorlike& no) {
        return where(condition, tensor_from(yes), tensor_from(no));
      },
      py::arg("condition"), py::arg("yes"), py::arg("no"), "condition: of integers, as comparisons give them.");
  module.def(
      "cast",
      [](const Tensor& x, const py::object& dtype) {
        const std::string name = py::str(py::dtype::from_args(dtype));
        for (const DType one : {DType::f32, DType::i32, DType::u32, DType::u8, DType::f16})
          if (name == name_of(one)) return cast(x, one);
        throw Error(Fault::usage, text("no tensor is of ", name));
      },
      py::arg("x"), py::arg("dtype"), "As another of NumPy's types.");
}

void add_reduction(py::module_& module, const char* name, Tensor (*op)(const Tensor&, const Reduce&)) {
  module.def(
      name,
      [op](const Tensor& x, const py::object& axis, bool keepdims) {
        return op(x, {axes_from(axis), keepdims});
      },
      py::arg("x"), py::arg("axis") = py::none(), py::arg("keepdims") = false, "Over an axis, several or all.");
}

void add_shapes(py::module_& module) {
  module.def(
      "reshape", [](const Tensor& x, const std::vector<int64_t>& s) { return reshape(x, shape_of(s)); }, py::arg("x"),
      py::arg("shape"));
  module.def(
      "permute", [](const Tensor& x, const std::vector<int64_t>& axes) { return permute(x, shape_of(axes)); },
      py::arg("x"), py::arg("axes"));
  module.def("transpose", &transpose, py::arg("x"), py::arg("axis_a") = -1, py::arg("axis_b") = -2);
  module.def(
      "broadcast_to", [](const Tensor& x, const std::vector<int64_t>& s) { return broadcast_to(x, shape_of(s)); },
      py::arg("x"), py::arg("shape"));
  module.def("unsqueeze", &unsqueeze, py::arg("x"), py::arg("axis"));
  module.def("concat", &concat, py::arg("parts"), py::arg("axis"));
  module.def("split", &split, py::arg("x"), py::arg("axis"), py::arg("sizes"));
  module.def("pad", &pad, py::arg("x"), py::arg("axis"), py::arg("before"), py::arg("after"), "By zeros.");
  module.def(
      "full", [](const std::vector<int64_t>& s, float value) { return full(shape_of(s), value); }, py::arg("shape"),
      py::arg("value"));
  module.def(
      "zeros", [](const std::vector<int64_t>& s) { return zeros(shape_of(s)); }, py::arg("shape"));
  module.def(
      "ones", [](const std::vector<int64_t>& s) { return ones(shape_of(s)); }, py::arg("shape"));
  using Random = Tensor (*)(const Shape&, const RandomKey&);
  const std::pair<const char*, Random> kinds[] = {
      {"random_uniform", &random_uniform},
      {"random_normal", [](const Shape& s, const RandomKey& key) { return random_normal(s, key); }}};
  for (const auto& [name, op] : kinds)
    module.def(
        name,
        [op = op](const std::vector<int64_t>& s, uint64_t seed, uint32_t step, uint32_t stream) {
          return op(shape_of(s), {seed, step, stream});
        },
        py::arg("shape"), py::arg("seed"), py::arg("step") = 0, py::arg("stream") = 0,
        "Numbers that depend on seed, step, stream and place alone.");
}

void add_networks(py::module_& module) {
  module.def("softmax", &softmax, py::arg("x"), py::arg("axis"), py::call_guard<Unlocked>());
  module.def("log_softmax", &log_softmax, py::arg("x"), py::arg("axis"), py::call_guard<Unlocked>());
  module.def("layer_norm", &layer_norm, py::arg("x"), py::arg("gamma"), py::arg("beta"), py::arg("epsilon") = 1e-5f);
  module.def(
      "conv2d",
      [](const Tensor& x, const Tensor& w, const std::optional<Tensor>& bias, int stride, int pad, int groups) {
        return conv2d(x, w, {stride, pad, groups}, {.bias = bias.value_or(Tensor())});
      },
      py::arg("x"), py::arg("w"), py::arg("bias") = py::none(), py::arg("stride") = 1, py::arg("pad") = 0,
      py::arg("groups") = 1, "x [N,C,H,W], w [K,C/groups,R,S] -> [N,K,P,Q].");
  module.def("attention", &attention, py::arg("q"), py::arg("k"), py::arg("v"), py::arg("scale") = 0.f,
             "softmax(q k^T scale) v; scale 0 is 1 / sqrt(D).");
  module.def(
      "max_pool2d",
      [](const Tensor& x, int window, int stride, int pad) {
        return max_pool2d(x, {window, stride, pad});
      },
      py::arg("x"), py::arg("window") = 2, py::arg("stride") = 2, py::arg("pad") = 0);
  module.def("resize_nearest", &resize_nearest, py::arg("x"), py::arg("height"), py::arg("width"));
  module.def("resize_bilinear", &resize_bilinear, py::arg("x"), py::arg("height"), py::arg("width"));
}

void add_rows(py::module_& module) {
  module.def(
      "cumsum", [](const Tensor& x, int axis) { return cumsum(x, axis); }, py::arg("x"), py::arg("axis"));
  module.def("gather_rows", &gather_rows, py::arg("table"), py::arg("rows"), "out[i] = table[rows[i]].");
  module.def("scatter_add_rows", &scatter_add_rows, py::arg("values"), py::arg("rows"), py::arg("count"),
             "out[r] = the sum of values[i] with rows[i] = r, in a fixed order.");
  module.def(
      "sort",
      [](const Tensor& keys) {
        const Sorted sorted = sort(keys);
        return std::pair(sorted.keys, sorted.order);
      },
      py::arg("keys"), py::call_guard<Unlocked>(), "Ascending and stable: the keys, and the places where they were.");
}

}  // namespace

void add_ops(py::module_& module, TensorClass& tensor) {
  add_operators(tensor);
  add_pointwise(module);
  add_reduction(module, "sum", &sum);
  add_reduction(module, "mean", &mean);
  add_reduction(module, "max", &max);
  add_reduction(module, "min", &min);
  add_shapes(module);
  add_networks(module);
  add_rows(module);
}

}  // namespace cloam
