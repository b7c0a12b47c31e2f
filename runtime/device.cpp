// Which device runs: listing, choosing, and the context and queue of the chosen one.
#include "runtime/device.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <sstream>
#include <utility>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/driver.h"
#include "runtime/environment.h"
#include "runtime/kernel_cache.h"
#include "runtime/nearest_name.h"

namespace cloam {
namespace {

struct Candidate {
  cl::Platform platform;
  cl::Device device;
  DeviceInfo info;
};

std::string lower(std::string s) {
  std::transform(s.begin(), s.end(), s.begin(), [](unsigned char c) { return std::tolower(c); });
  return s;
}

std::string trimmed(std::string s) {
  while (!s.empty() && (std::isspace(static_cast<unsigned char>(s.back())) || s.back() == '\0')) s.pop_back();
  return s;
}

/// Fat work-items pay where one work-item is a core's loop: PoCL's and Intel's CPU devices. llvmpipe is a CPU that
/// behaves like a small GPU (32 KiB local memory, lanes), so it runs the GPU shapes.
DeviceClass class_of(const DeviceInfo& info) {
  if (debug().float64) return DeviceClass::gpu;  // few of its kernels care how wide a vector of floats is
  if (const char* forced = std::getenv("CLOAM_DEVICE_CLASS"))
    return std::strcmp(forced, "gpu") == 0 ? DeviceClass::gpu : DeviceClass::cpu;
  const bool lanes = lower(info.platform + info.name).find("llvmpipe") != std::string::npos;
  return info.is_cpu && !lanes ? DeviceClass::cpu : DeviceClass::gpu;
}

DeviceInfo describe(const cl::Platform& platform, const cl::Device& device, const std::string& id) {
  DeviceInfo info;
  info.id = id;
  info.name = trimmed(device.getInfo<CL_DEVICE_NAME>());
  info.platform = trimmed(platform.getInfo<CL_PLATFORM_NAME>());
  info.driver = trimmed(device.getInfo<CL_DRIVER_VERSION>());
  info.cl_version = trimmed(device.getInfo<CL_DEVICE_VERSION>());
  info.is_cpu = (device.getInfo<CL_DEVICE_TYPE>() & CL_DEVICE_TYPE_CPU) != 0;
  info.shares_host_memory = device.getInfo<CL_DEVICE_HOST_UNIFIED_MEMORY>() != 0;
  info.global_bytes = device.getInfo<CL_DEVICE_GLOBAL_MEM_SIZE>();
  info.max_alloc_bytes = device.getInfo<CL_DEVICE_MAX_MEM_ALLOC_SIZE>();
  info.local_bytes = device.getInfo<CL_DEVICE_LOCAL_MEM_SIZE>();
  info.cache_bytes = device.getInfo<CL_DEVICE_GLOBAL_MEM_CACHE_SIZE>();
  info.compute_units = static_cast<int>(device.getInfo<CL_DEVICE_MAX_COMPUTE_UNITS>());
  info.max_work_group = static_cast<int>(device.getInfo<CL_DEVICE_MAX_WORK_GROUP_SIZE>());
  info.device_class = class_of(info);
  return info;
}

/// PoCL's workers often wake on one core without this (half speed). It pins them from core 0 on: several programs that
/// are given fewer workers than there are cores would share the first ones, and are left to the scheduler. Must be set
/// before the first CL call. Says who did.
std::string pin_pocl_threads() {
  static const bool by_user = std::getenv("POCL_AFFINITY") != nullptr;
  setenv("POCL_AFFINITY", std::getenv("POCL_MAX_PTHREAD_COUNT") ? "0" : "1", 0);
  return text("POCL_AFFINITY=", std::getenv("POCL_AFFINITY"), by_user ? " (set by the user)" : " (set by cloam)");
}

/// All devices that answer, and what the others gave instead: no driver that is broken stands in another's way.
struct Candidates {
  std::vector<Candidate> all;
  std::string broken;
};

void add_devices(const cl::Platform& platform, size_t number, Candidates& out) {
  std::vector<cl::Device> devices;
  platform.getDevices(CL_DEVICE_TYPE_ALL, &devices);
  for (size_t d = 0; d < devices.size(); d++)
    out.all.push_back({platform, devices[d], describe(platform, devices[d], text(number, ":", d))});
}

Candidates candidates() {
  const std::string pinning = pin_pocl_threads();
  if (!kernel_cache().usable) throw Error(Fault::write, kernel_cache().note);  // PoCL would end the process
  Candidates out;
  std::vector<cl::Platform> platforms;
  try {
    cl::Platform::get(&platforms);
  } catch (const cl::Error&) {
    return out;  // the loader's way to say: no driver installed
  }
  for (size_t p = 0; p < platforms.size(); p++) {
    try {
      add_devices(platforms[p], p, out);
    } catch (const cl::Error& error) {
      if (error.err() != CL_DEVICE_NOT_FOUND)
        out.broken += text("\n  driver ", p, " does not work: ", error.what(), " gave ", code_text(error.err()));
    }
  }
  for (Candidate& c : out.all)
    if (c.info.platform == "Portable Computing Language") c.info.pinning = pinning;
  return out;
}

std::string table(const std::vector<const Candidate*>& rows) {
  std::string out;
  for (const Candidate* c : rows) out += text("\n  ", c->info.id, "  ", c->info.name, " (", c->info.platform, ")");
  return out;
}

/// What --device may name: for typing mistakes.
std::vector<std::string> words_of(const std::vector<const Candidate*>& rows) {
  std::vector<std::string> words = {"auto", "cpu", "gpu"};
  for (const Candidate* c : rows) {
    std::string names = lower(c->info.name + " " + c->info.platform);
    std::replace(names.begin(), names.end(), '-', ' ');
    std::istringstream stream(names);
    for (std::string word; stream >> word;) words.push_back(word);
  }
  return words;
}

bool matches(const Candidate& c, size_t position, const std::string& wish) {
  const std::string want = lower(wish);
  if (want == "cpu") return c.info.is_cpu;
  if (want == "gpu") return !c.info.is_cpu;
  if (want == c.info.id || want == std::to_string(position)) return true;
  return lower(c.info.name + " " + c.info.platform).find(want) != std::string::npos;
}

/// A GPU before a CPU; among equals the larger memory is no criterion (drivers report it at whim), the order is.
int rank(const Candidate& c) { return c.info.is_cpu ? 1 : 0; }

const Candidate& chosen_among(const Candidates& found, const std::string& wish) {
  const std::vector<Candidate>& all = found.all;
  if (all.empty())
    throw Error(Fault::device,
                text("no OpenCL device found. Looked for drivers in ",
                     std::getenv("OCL_ICD_VENDORS") ? std::getenv("OCL_ICD_VENDORS") : "/etc/OpenCL/vendors",
                     " and found none that works",
                     std::getenv("POCL_DEVICES") ? text(" (POCL_DEVICES=", std::getenv("POCL_DEVICES"), ")") : "", ".",
                     found.broken,
                     "\n  fix: sudo apt install pocl-opencl-icd   (any CPU), or your GPU's "
                     "OpenCL driver; unset OCL_ICD_VENDORS if it points to the wrong place; cloam doctor says more"));
  std::vector<const Candidate*> any, fit;
  for (size_t i = 0; i < all.size(); i++) {
    any.push_back(&all[i]);
    if (wish == "auto" || matches(all[i], i, wish)) fit.push_back(&all[i]);
  }
  if (fit.empty())
    throw Error(Fault::device, text("no OpenCL device matches --device \"", wish, "\"",
                                    did_you_mean(lower(wish), words_of(any)), "\n  found:", table(any), found.broken,
                                    "\n  fix: name one of these by its number or a part of its name (in "
                                    "CLOAM_DEVICE too); cloam doctor says why a device is missing"));
  const bool by_kind = wish == "auto" || lower(wish) == "cpu" || lower(wish) == "gpu";
  if (fit.size() > 1 && !by_kind)
    throw Error(Fault::usage,
                text("--device \"", wish, "\" matches several devices; name one by its number:", table(fit)));
  return **std::min_element(fit.begin(), fit.end(),
                            [](const Candidate* a, const Candidate* b) { return rank(*a) < rank(*b); });
}

DeviceOptions device_options;
std::optional<ClDevice> opened;
std::atomic<ClDevice*> device_in_use = nullptr;  // what was opened: asked for at each launch, without the lock
std::atomic<bool> was_left = false;

/// Drivers have threads, and a forked process has none of them: what it asks of the device would wait for ever.
void leave_device() {
  if (!device_in_use.exchange(nullptr)) return;
  was_left = true;
  DeviceLock::renew();
}

void check_not_left() {
  if (!was_left) return;
  throw Error(Fault::device,
              text("this process was forked from one that had opened its device, which cannot be used in both\n  fix: ",
                   "start worker processes anew (multiprocessing.set_start_method(\"spawn\") in Python), or fork them ",
                   "before the device is used"));
}

void open_device() {
  check_not_left();
  [[maybe_unused]] static const int told = pthread_atfork(nullptr, nullptr, leave_device);
  const char* environment = std::getenv("CLOAM_DEVICE");
  const std::string wish = device_options.device == "auto" && environment ? environment : device_options.device;
  check_environment();
  const Candidates found = candidates();
  const Candidate& c = chosen_among(found, wish);
  try {
    cl::Context context(c.device);
    cl::CommandQueue queue(context, c.device, debug().kernels ? CL_QUEUE_PROFILING_ENABLE : 0);
    opened = ClDevice{c.platform, c.device, context, queue, c.info};
    device_in_use = &*opened;
    start_watchdog(c.info.is_cpu);
  } catch (const cl::Error& error) {
    opening_failed(error, "open the device", text(c.info.name, " (", c.info.platform, ", driver ", c.info.driver, ")"));
  }
}

Debug parse_debug() {
  Debug out;
  const char* given = std::getenv("CLOAM_DEBUG");
  std::istringstream words(given ? given : "");
  for (std::string word; std::getline(words, word, ',');) {
    if (word == "kernels") out.kernels = true;
    if (word == "nan") out.nan = true;
    if (word == "poison") out.poison = true;
    if (word == "bounds") out.bounds = true;
    if (word == "sync") out.sync = true;
    if (word == "float64") out.float64 = true;
  }
  return out;
}

}  // namespace

const Debug& debug() {
  static const Debug switches = parse_debug();
  return switches;
}

namespace {
thread_local bool nan_is_wanted = false;
}

void look_for_nan(bool on) { nan_is_wanted = on; }
bool looking_for_nan() { return nan_is_wanted; }

std::vector<DeviceInfo> list_devices() {
  const DeviceLock lock;
  std::vector<DeviceInfo> out;
  for (const Candidate& c : candidates().all) out.push_back(c.info);
  return out;
}

void choose_device(const DeviceOptions& options) {
  const DeviceLock lock;
  const DeviceOptions before = std::exchange(device_options, options);
  if (device_in_use) return;
  try {
    open_device();
  } catch (const Error&) {  // whoever chooses again begins where this one began
    device_options = before;
    throw;
  }
}

ClDevice& cl_device() {
  if (ClDevice* const one = device_in_use) return *one;
  const DeviceLock lock;
  if (!device_in_use) open_device();
  return *device_in_use;
}

bool left_by_fork() { return was_left; }

const DeviceInfo& device() { return cl_device().info; }
bool is_cpu_class() { return device().device_class == DeviceClass::cpu; }

bool reference_variants() {
  static const bool wanted_reference = [] {
    const char* variant = std::getenv("CLOAM_VARIANT");
    return debug().float64 || (variant && std::strcmp(variant, "reference") == 0);
  }();
  return wanted_reference;
}

DeviceStats& device_stats() {
  static DeviceStats stats;
  return stats;
}

uint64_t wanted_max_bytes() { return device_options.max_bytes; }

}  // namespace cloam
