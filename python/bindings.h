// Python's module `cloam`: a file a subject, each of which adds its part. Values are NumPy arrays; errors are
// cloam.Error. The interpreter's lock is given back in all that computes, reads or writes (Unlocked), and nothing takes
// it while it holds a DeviceLock, so that threads of Python work side by side and none waits for another for ever.
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <unistd.h>

#include "models/runs/listener.h"
#include "runtime/error.h"
#include "runtime/tensor.h"

namespace cloam {

namespace py = pybind11;

/// Takes the interpreter's lock. Where Python has ended meanwhile it would end the thread by unwinding its stack,
/// through destructors that must not throw, which ends the process instead: the thread stays here for ever.
template <class Take>
auto locked_by(const Take& take) {
  try {
    return take();
  } catch (...) {
    for (;;) ::pause();
  }
}

/// Without the interpreter's lock, which the thread had.
class Unlocked {
 public:
  Unlocked() : state_(PyEval_SaveThread()) {}
  ~Unlocked() {
    locked_by([this] { PyEval_RestoreThread(state_); });
  }
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  PyThreadState* state_;
};

/// With it, which any thread may take that does not have it.
class Locked {
 public:
  Locked() : state_(locked_by(PyGILState_Ensure)) {}
  ~Locked() { PyGILState_Release(state_); }
  Locked(const Locked&) = delete;
  Locked& operator=(const Locked&) = delete;

 private:
  PyGILState_STATE state_;
};

/// What a tensor held may wait for a thread that uses the device: others go on meanwhile.
struct DeletedUnlocked {
  template <class Held>
  void operator()(Held* held) const {
    const Unlocked others;
    delete held;
  }
};
template <class Held>
using Owned = std::unique_ptr<Held, DeletedUnlocked>;
using TensorClass = py::class_<Tensor, Owned<Tensor>>;

void add_errors(py::module_& module);
void add_devices(py::module_& module);
TensorClass add_tensors(py::module_& module);
void add_ops(py::module_& module, TensorClass& tensor);
void add_metrics(py::module_& module);
void add_runs(py::module_& module);
void add_training(py::module_& module);

/// Opens the device as the program does: kernels that selftest found wrong on it are switched off, and a device that
/// computes wrong results is refused. Fault::device.
void open_device();

/// A tensor, a number or an array as a tensor. Fault::usage for anything else.
Tensor tensor_from(const py::handle& value);

using Floats = py::array_t<float, py::array::c_style | py::array::forcecast>;
/// An array of what NumPy makes of the values. Fault::usage, naming `what` they are, for anything but real numbers.
py::array numbers_from(const py::object& values, const char* what);
/// The same as floats.
Floats floats_from(const py::object& values, const char* what);
/// A whole number of Python's or NumPy's.
bool is_whole(const py::handle& value);

template <class Value>
struct Wanted {
  static constexpr const char* kWords = std::is_same_v<Value, bool>       ? "True or False"
                                        : std::is_unsigned_v<Value>       ? "a whole number from 0 on"
                                        : std::is_integral_v<Value>       ? "a whole number"
                                        : std::is_floating_point_v<Value> ? "a number"
                                                                          : "another type";
};
template <class Value>
struct Wanted<std::optional<Value>> : Wanted<Value> {};
template <>
struct Wanted<std::vector<int>> {
  static constexpr const char* kWords = "a whole number, or a list of them";
};

/// The value of an option. Fault::usage, naming it, for one of another type.
template <class Value>
Value option_as(const std::string& name, const py::handle& value) {
  try {
    return value.cast<Value>();
  } catch (const py::cast_error&) {
    throw Error(Fault::usage, text(name, "=", std::string(py::repr(value)), ": want ", Wanted<Value>::kWords));
  }
}

/// A new array of that shape with a copy of the values.
template <class Value>
py::array_t<Value> array_of(const std::vector<Value>& values, const std::vector<py::ssize_t>& shape) {
  return py::array_t<Value>(shape, values.data());
}

/// Throws KeyboardInterrupt if Ctrl-C came. Called between two parts of long work, without the interpreter's lock.
void check_interrupt();
/// What long work says goes to Python's warnings; Ctrl-C ends it.
Listener python_listener();
/// A warning of Python's.
void python_warning(const std::string& warning);

}  // namespace cloam
