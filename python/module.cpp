// Puts the parts together, and the error that all of them throw.
#include <pthread.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "models/runs/version.h"
#include "python/bindings.h"
#include "runtime/device_lock.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kAbout[] =
    R"(3D reconstruction and generation on any OpenCL device.

devices(), choose_device()      which device computes
tensor(), parameter(), grad()   tensors and gradients; NumPy arrays in and out
load()                          a trained run: render, edit, save, generate
Training                        a training, one step at a time
psnr(), ssim(), Lpips, chamfer()

Errors are cloam.Error, whose fault says of which kind; int(fault) is the exit code of the program.)";

/// Names of files may be any bytes.
py::object words_of(const std::string& bytes) {
  return py::reinterpret_steal<py::object>(
      PyUnicode_DecodeUTF8(bytes.data(), static_cast<py::ssize_t>(bytes.size()), "replace"));
}

/// Of every cloam::Error: cloam.Error(message) with the attribute `fault`.
void raise(const Error& error) {
  const py::object type = py::module_::import("cloam").attr("Error");
  const py::object raised = type(words_of(error.what()));
  raised.attr("fault") = py::cast(error.fault());
  PyErr_SetObject(type.ptr(), raised.ptr());
}

const pid_t kImporter = getpid();

/// Threads that still compute while the process ends would meet what has gone: none gets the device any more. A forked
/// process has none of them, and may wait for ever for one that held the lock.
void keep_device_at_end() {
  if (getpid() == kImporter) (void)new DeviceLock;
}

/// OpenVDB's log4cplus waits at exit() for threads that a fork does not take along: a forked process would never end.
/// What it registers at exit comes before all that its parent did, and leaves that to the parent.
void end_forked_processes() {
  pthread_atfork(nullptr, nullptr, [] {
    on_exit(
        [](int status, void*) {
          std::fflush(nullptr);
          _exit(status);
        },
        nullptr);
  });
}

}  // namespace

void add_errors(py::module_& module) {
  py::enum_<Fault>(module, "Fault", "Of which kind an error is; int() is the exit code of the program.")
      .value("internal", Fault::internal)
      .value("usage", Fault::usage)
      .value("data", Fault::data)
      .value("device", Fault::device)
      .value("memory", Fault::memory)
      .value("diverged", Fault::diverged)
      .value("verification", Fault::verification)
      .value("write", Fault::write);
  py::object error = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
      "cloam.Error", "What went wrong, in words that say how to mend it; .fault is its cloam.Fault.",
      PyExc_RuntimeError, nullptr));
  error.attr("fault") = py::cast(Fault::internal);
  module.attr("Error") = error;
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& of_ours) { raise(of_ours); }
  });
}

void check_interrupt() {
  const Locked locked;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
}

void python_warning(const std::string& warning) {
  const Locked locked;
  const py::object words = words_of(warning);
  if (PyErr_WarnEx(PyExc_UserWarning, PyUnicode_AsUTF8(words.ptr()), 1) != 0) throw py::error_already_set();
}

Listener python_listener() {
  return {[](const std::string&) {}, python_warning, [](const std::function<std::string()>&) { check_interrupt(); }};
}

}  // namespace cloam

PYBIND11_MODULE(cloam, module) {
  module.doc() = cloam::kAbout;
  module.attr("__version__") = cloam::kVersion;
  cloam::add_errors(module);
  Py_AtExit(cloam::keep_device_at_end);
  cloam::end_forked_processes();
  cloam::add_devices(module);
  cloam::TensorClass tensor = cloam::add_tensors(module);
  cloam::add_ops(module, tensor);
  cloam::add_metrics(module);
  cloam::add_runs(module);
  cloam::add_training(module);
}
