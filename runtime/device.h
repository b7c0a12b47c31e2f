// The OpenCL device of this process: choice, limits, statistics. No CL header is needed to use it.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace cloam {

/// CPU devices run fat work-items (one is a core's loop); GPU devices run lanes.
enum class DeviceClass { cpu, gpu };

struct DeviceInfo {
  std::string id;  // "platform:device", the reproducible spelling for --device
  std::string name, platform, driver, cl_version;
  DeviceClass device_class = DeviceClass::cpu;
  bool is_cpu = false;
  bool shares_host_memory = false;  // the host sees its buffers in place
  uint64_t global_bytes = 0, max_alloc_bytes = 0, local_bytes = 0;
  std::string pinning;       // of PoCL's threads to cores: "POCL_AFFINITY=1 (set by cloam)"; empty for other drivers
  uint64_t cache_bytes = 0;  // of the last level
  int compute_units = 0, max_work_group = 0;
};

/// Every device of every platform. Empty when there is no OpenCL driver.
std::vector<DeviceInfo> list_devices();

struct DeviceOptions {
  std::string device = "auto";  // auto | cpu | gpu | N | P:D | part of a name (platform or device)
  uint64_t max_bytes = 0;       // 0: 80 % of what the device and the host have free
};
/// Chooses the device before its first use. Throws Fault::device naming what is there and what to install.
void choose_device(const DeviceOptions& options);
/// The chosen device (chooses "auto" or $CLOAM_DEVICE at first use).
const DeviceInfo& device();

/// Of the process: of all its threads.
struct DeviceStats {
  int64_t launches = 0, kernels_built = 0, plans_built = 0, plans_reused = 0;
  int64_t waits = 0;                                             // times the host waited for the device
  uint64_t live_bytes = 0, peak_bytes = 0, allocated_bytes = 0;  // allocated: asked from the driver so far
  uint64_t kept_bytes = 0;                                       // freed, and kept to be used again
  double wait_seconds = 0;                                       // host blocked on the device
  double build_seconds = 0;
};
DeviceStats& device_stats();
/// Called after each program that was compiled or taken from the driver's cache, with the statistics so far, by the
/// thread that needed it, while others wait.
void on_build(std::function<void(const DeviceStats&)> listener);
uint64_t memory_budget();
/// Gives cached free buffers back to the driver.
void trim_memory();

}  // namespace cloam
