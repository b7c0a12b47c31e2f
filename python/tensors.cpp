// Tensors: NumPy arrays in and out, gradients, and what changes values.
#include <cstring>

#include "python/bindings.h"
#include "runtime/error.h"
#include "runtime/flat.h"
#include "runtime/ops/adam.h"

namespace cloam {
namespace {

Shape shape_from(const py::array& array) {
  if (array.ndim() > kMaxRank)
    throw Error(Fault::usage, text("an array has ", array.ndim(), " axes, tensors have ", kMaxRank, " at most"));
  Shape shape;
  for (py::ssize_t axis = 0; axis < array.ndim(); ++axis) shape.push_back(array.shape(axis));
  return shape;
}

/// Copied: an array may be written later, and a tensor's values never change.
template <class Value>
Tensor copied(const py::array& given, DType dtype) {
  const auto values = py::array_t<Value, py::array::c_style | py::array::forcecast>::ensure(given);
  if (!values) throw py::error_already_set();
  const Shape shape = shape_from(values);
  const Unlocked others;
  open_device();
  return from_bytes(values.data(), dtype, shape);
}

Tensor from_array(const py::array& array) {
  const std::string type = py::str(array.dtype());
  if (type == "float32" || type == "float64") return copied<float>(array, DType::f32);
  if (type == "float16") return cast(copied<float>(array, DType::f32), DType::f16);
  if (type == "int32" || type == "bool") return copied<int32_t>(array, DType::i32);
  if (type == "uint32") return copied<uint32_t>(array, DType::u32);
  if (type == "uint8") return copied<uint8_t>(array, DType::u8);
  const bool one_whole = array.ndim() == 0 && (array.dtype().kind() == 'i' || array.dtype().kind() == 'u');
  if (one_whole) return tensor_from(array.attr("item")());  // numpy.int64(2) is a number
  throw Error(Fault::usage, text("an array of ", type, ": tensors are of float32, float16, int32, uint32 or uint8",
                                 "\n  fix: array.astype(numpy.int32), say"));
}

py::dtype dtype_of(const Tensor& tensor) {
  return py::dtype(tensor.dtype() == DType::f16 ? "float16" : name_of(tensor.dtype()));
}

std::vector<py::ssize_t> extents(const Tensor& tensor) { return {tensor.shape().begin(), tensor.shape().end()}; }

/// In place where the device's memory is the host's: the array keeps the memory, and nobody may write it.
py::object array_in_place(const Tensor& tensor) {
  std::shared_ptr<const std::byte> view;
  {
    const Unlocked others;
    view = host_view(tensor);
  }
  if (!view) return py::none();
  auto* const held = new std::shared_ptr<const std::byte>(view);
  const py::capsule owner(
      held, [](void* memory) { DeletedUnlocked()(static_cast<std::shared_ptr<const std::byte>*>(memory)); });
  py::array array(dtype_of(tensor), extents(tensor), view.get(), owner);
  array.attr("setflags")(py::arg("write") = false);
  return py::object(array);
}

template <class Value>
void copy_to(const Tensor& tensor, void* to) {
  const std::vector<Value> values = tensor.to_host<Value>();
  std::memcpy(to, values.data(), values.size() * sizeof(Value));
}

py::array array_copied(const Tensor& tensor) {
  const DType dtype = tensor.dtype();
  py::array array(dtype == DType::f16 ? py::dtype("float32") : dtype_of(tensor), extents(tensor));
  void* const to = array.mutable_data();
  {
    const Unlocked others;
    if (dtype == DType::i32)
      copy_to<int32_t>(tensor, to);
    else if (dtype == DType::u32)
      copy_to<uint32_t>(tensor, to);
    else if (dtype == DType::u8)
      copy_to<uint8_t>(tensor, to);
    else
      copy_to<float>(tensor, to);
  }
  return dtype == DType::f16 ? py::array(array.attr("astype")("float16")) : array;
}

py::object numpy(const Tensor& tensor, bool copy) {
  const py::object in_place = copy ? py::none() : array_in_place(tensor);
  return in_place.is_none() ? py::object(array_copied(tensor)) : in_place;
}

/// NumPy gives Python's whole numbers 64 bits, which no tensor has.
py::array as_int32(const py::array& whole) {
  const py::array narrow = whole.attr("astype")("int32");
  if (py::module_::import("numpy").attr("array_equal")(narrow, whole).cast<bool>()) return narrow;
  throw Error(Fault::usage,
              "whole numbers of a tensor are of int32, from -2147483648 to 2147483647, and some lie outside"
              "\n  fix: give them as floats, or as an array of numpy.uint32");
}

Tensor new_tensor(const py::object& values) {
  const py::array array = numbers_from(values, "a tensor");
  const bool untyped = array.ndim() == 0 || !py::hasattr(values, "dtype");
  const bool wide = array.itemsize() == 8 && array.dtype().kind() != 'f';
  return from_array(untyped && wide ? as_int32(array) : array);
}

Tensor new_parameter(const py::object& values) {
  const Floats floats = floats_from(values, "a parameter");
  const std::vector<float> host(floats.data(), floats.data() + floats.size());
  const Shape shape = shape_from(floats);
  const Unlocked others;
  open_device();
  return parameter(host, shape);
}

/// A float, or an int of what holds integers.
py::object one_value(const Tensor& tensor) {
  if (tensor.numel() != 1)
    throw Error(Fault::internal, text("[item] shape ", to_string(tensor.shape()), " is not one value"));
  return array_copied(tensor).attr("item")();
}

std::string tensor_words(const Tensor& tensor) {
  return text("<cloam.Tensor ", to_string(tensor.shape()), " ", name_of(tensor.dtype()),
              tensor.tracked() ? ", with gradient>" : ">");
}

/// Adam (Kingma and Ba 2015), with decoupled weight decay.
struct Adam {
  Tensors parameters, m, v;
  AdamStep how;

  Adam(const Tensors& given, float rate, std::pair<float, float> betas, float weight_decay) : parameters(given) {
    how.learning_rate = rate;
    how.beta1 = betas.first;
    how.beta2 = betas.second;
    how.weight_decay = weight_decay;
    how.step = 0;
    for (const Tensor& p : parameters) {
      if (!p.tracked() || !p.evaluated())
        throw Error(Fault::usage, "Adam steps what cloam.parameter() made, and nothing that was computed");
      m.push_back(made_to_stay(zeros(p.shape())));
      v.push_back(made_to_stay(zeros(p.shape())));
    }
  }
  void step(const Tensors& gradients) {
    if (gradients.size() != parameters.size())
      throw Error(Fault::usage, text(gradients.size(), " gradients for ", parameters.size(), " parameters"));
    eval(gradients);
    how.step++;
    for (size_t i = 0; i < parameters.size(); ++i) adam_step(parameters[i], m[i], v[i], gradients[i], how);
  }
};

void add_adam(py::module_& module) {
  py::class_<Adam>(module, "Adam", "The optimiser Adam: steps parameters in place.")
      .def(py::init<const Tensors&, float, std::pair<float, float>, float>(), py::arg("parameters"),
           py::arg("learning_rate") = 1e-3f, py::arg("betas") = std::pair(0.9f, 0.999f), py::arg("weight_decay") = 0.f,
           py::call_guard<Unlocked>())
      .def("step", &Adam::step, py::arg("gradients"), py::call_guard<Unlocked>(),
           "One step; a gradient for each parameter, in their order.")
      .def_property(
          "learning_rate", [](const Adam& adam) { return adam.how.learning_rate; },
          [](Adam& adam, float rate) { adam.how.learning_rate = rate; });
}

void add_gradients(py::module_& module) {
  module.def(
      "eval",
      [](const py::args& tensors) {
        const auto all = py::cast<Tensors>(py::list(tensors));
        const Unlocked others;
        eval(all);
      },
      "Computes all of the tensors together; what is not asked for and not needed again is not kept.");
  module.def(
      "grad",
      [](const Tensor& of, const Tensors& wrt, const std::optional<Tensor>& g) {
        return g ? grad(of, wrt, *g) : grad(of, wrt);
      },
      py::arg("loss"), py::arg("wrt"), py::arg("g") = py::none(), py::call_guard<Unlocked>(),
      "d loss / d each of wrt, as tensors that can be differentiated again. Without g (d something / d loss, of its "
      "shape) the loss has one element. Zeros where the loss does not depend on a tensor, and of one that is not "
      "tracked: gradients reach parameters, and what was computed from them.");
  module.def(
      "assign",
      [](const Tensor& target, const py::object& value) {
        const Tensor with = tensor_from(value);
        const Unlocked others;
        assign({{target, with}});
      },
      py::arg("target"), py::arg("value"), "Gives a tensor other values of its shape, which all handles on it see.");
}

}  // namespace

py::array numbers_from(const py::object& values, const char* what) {
  try {
    py::array array(values);
    if (std::strchr("biuf", array.dtype().kind())) return array;
    throw Error(Fault::usage,
                text("want numbers for ", what, ", found an array of ", std::string(py::str(array.dtype()))));
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_TypeError)) throw;
    throw Error(Fault::usage, text("want numbers for ", what, ": ", std::string(py::str(error.value()))));
  }
}

Floats floats_from(const py::object& values, const char* what) { return Floats(numbers_from(values, what)); }

bool is_whole(const py::handle& value) { return PyIndex_Check(value.ptr()) && !py::isinstance<py::array>(value); }

Tensor tensor_from(const py::handle& value) {
  if (py::isinstance<Tensor>(value)) return value.cast<Tensor>();
  if (py::isinstance<py::bool_>(value) || py::isinstance<py::int_>(value)) {
    const auto whole = value.cast<double>();
    return whole >= -0x1p31 && whole < 0x1p31 ? Tensor(static_cast<int>(whole)) : Tensor(whole);
  }
  if (py::isinstance<py::float_>(value)) return Tensor(value.cast<double>());
  if (py::isinstance<py::array>(value)) return from_array(value.cast<py::array>());
  if (py::hasattr(value, "__array__")) return from_array(py::array(py::cast<py::object>(value)));  // numpy.float32(1)
  throw Error(Fault::usage, text("want a tensor, a number or an array, found ",
                                 std::string(py::str(py::type::handle_of(value).attr("__name__")))));
}

TensorClass add_tensors(py::module_& module) {
  TensorClass tensor(module, "Tensor",
                     "Values on the device, or how to compute them; they never change but by assign() "
                     "and an optimiser's step.");
  tensor.def_property_readonly("shape", [](const Tensor& t) { return py::tuple(py::cast(extents(t))); })
      .def_property_readonly("dtype", &dtype_of)
      .def_property_readonly("ndim", &Tensor::rank)
      .def_property_readonly("size", &Tensor::numel)
      .def_property_readonly("tracked", &Tensor::tracked, "Whether a gradient can flow through it.")
      .def("numpy", &numpy, py::arg("copy") = false,
           R"(The values, computed if need be, as an array.

In place and read-only where host and device share memory, and a copy elsewhere, of parameters (an optimiser writes them
in place) and with copy=True. An array in place holds the tensor's memory for as long as it lives.)")
      .def(
          "__array__",
          [](const Tensor& t, const py::object& dtype, const py::object&) {
            const py::object array = numpy(t, false);
            return dtype.is_none() ? array : py::object(array.attr("astype")(dtype));
          },
          py::arg("dtype") = py::none(), py::arg("copy") = py::none())
      .def("item", &one_value, "The value of a tensor with one element: a float, or an int of integers.")
      .def("__float__", [](const Tensor& t) { return py::float_(one_value(t)); })
      .def("__iter__",
           [](const py::object& self) {
             if (self.cast<const Tensor&>().rank() == 0) throw py::type_error("a tensor without axes has no rows");
             return py::reinterpret_steal<py::object>(PySeqIter_New(self.ptr()));
           })
      .def("__len__",
           [](const Tensor& t) {
             if (t.rank() == 0) throw py::type_error("a tensor without axes has no length");
             return t.dim(0);
           })
      .def("__repr__", &tensor_words)
      .def("__bool__",
           [](const Tensor&) -> bool { throw py::type_error("a tensor is neither true nor false: ask its item()"); });
  module.def("tensor", &new_tensor, py::arg("values"),
             "A tensor with a copy of the values: float32 (also of float64), float16, int32 (also of Python's whole "
             "numbers), uint32 or uint8.");
  module.def("parameter", &new_parameter, py::arg("values"),
             "A tensor of float32 that gradients reach and optimisers step.");
  add_gradients(module);
  add_adam(module);
  return tensor;
}

}  // namespace cloam
