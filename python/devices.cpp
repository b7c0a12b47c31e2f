// Devices: which there are, and which one computes.
#include <mutex>

#include "python/bindings.h"
#include "runtime/device.h"
#include "runtime/device_lock.h"
#include "runtime/error.h"
#include "runtime/variant.h"
#include "runtime/verdict.h"

namespace cloam {
namespace {

void heed_verdict() {
  const std::optional<Verdict> verdict = verdict_of(device());
  if (!verdict) return;
  std::vector<std::string> families;
  for (const SwitchedOff& off : verdict->off) families.push_back(off.family);
  switch_off(families);
  if (verdict->passed()) return;
  throw Error(Fault::device, text("device ", device().name, " ", words_of(verdict), ", first \"",
                                  verdict->failed.front(), "\": its results would be wrong\n  fix: update its driver ",
                                  "and run cloam selftest --quick, or choose another device: cloam.devices()"));
}

std::string device_words(const DeviceInfo& info) {
  return "<cloam.Device " + info.id + ": " + info.name + " (" + info.platform + ")>";
}

}  // namespace

void open_device() {
  static std::once_flag heeded;
  device();
  std::call_once(heeded, heed_verdict);
}

void add_devices(py::module_& module) {
  py::class_<DeviceInfo>(module, "Device", "A device of an OpenCL driver.")
      .def_readonly("id", &DeviceInfo::id, "\"platform:device\", which chooses it again")
      .def_readonly("name", &DeviceInfo::name)
      .def_readonly("platform", &DeviceInfo::platform)
      .def_readonly("driver", &DeviceInfo::driver)
      .def_readonly("is_cpu", &DeviceInfo::is_cpu)
      .def_readonly("shares_host_memory", &DeviceInfo::shares_host_memory, "whether the host sees its memory in place")
      .def_readonly("memory_bytes", &DeviceInfo::global_bytes)
      .def("__repr__", &device_words);
  module.def("devices", &list_devices, py::call_guard<Unlocked>(), "All devices that answer.");
  module.def(
      "device",
      [] {
        open_device();
        return device();
      },
      py::call_guard<Unlocked>(), "The device that computes: the one chosen, or else $CLOAM_DEVICE, or else a GPU.");
  module.def(
      "choose_device",
      [](const std::string& name, uint64_t max_bytes) {
        choose_device({name, max_bytes});
        open_device();
        return device();
      },
      py::arg("name") = "auto", py::arg("max_bytes") = 0, py::call_guard<Unlocked>(),
      R"(Chooses the device, once a process and before anything is computed; a later call only sets max_bytes.

name: auto, cpu, gpu, a number, an id, or a part of a name. max_bytes: of the device's memory; 0: 80 % of what is free.)");
  module.def(
      "memory_in_use",
      [] {
        const DeviceLock lock;
        return device_stats().live_bytes;
      },
      py::call_guard<Unlocked>(), "Bytes of the device's memory that all tensors of this process take.");
}

}  // namespace cloam
