// See profile.h. The device's time stamps have an origin of their own: the first launch ties it to the host's clock.
#include "runtime/profile.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <map>
#include <new>
#include <optional>
#include <sstream>

#include "runtime/cl.h"
#include "runtime/device_lock.h"
#include "runtime/driver.h"

namespace cloam {
namespace {

constexpr int64_t kWarmSteps = 3;
constexpr size_t kMaxSpans = 2'000'000;  // of the timeline: 100 MB of text

double host_us() {
  return 1e-3 * static_cast<double>(std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1));
}

struct Launched {
  cl::Event event;
  const char* name;
  double flops, bytes;
  double at_us;  // of the host's clock
  bool in_step;  // counts for the means of the steps
};

struct Span {
  const char* name;
  double begin, length;  // microseconds of the host's clock
  bool on_device;
};

/// Counters at the end of a step.
struct Mark {
  double at_us = 0;
  DeviceStats stats;
};

struct Recorder {
  bool timeline = false;
  double began_us = 0;
  DeviceStats began;
  std::deque<Launched> pending;
  std::map<std::string, KernelCost> kernels;
  std::vector<Span> spans;
  std::optional<double> device_to_host_us;
  int64_t steps = 0;
  Mark first, last;  // after the warm steps, and now
  double step_device_us = 0;
};

std::optional<Recorder>& profile_recorder() {
  static std::optional<Recorder> one;
  return one;
}

template <class Call>
auto asked_of(const Launched& launched, const Call& call) {
  return called([&] { return text("time the kernel ", launched.name); }, call);
}

double stamp_us(const Launched& launched, cl_profiling_info what) {
  return asked_of(launched, [&] {
    cl_ulong nanoseconds = 0;
    const cl_int code = clGetEventProfilingInfo(launched.event(), what, sizeof nanoseconds, &nanoseconds, nullptr);
    if (code != CL_SUCCESS) throw cl::Error(code, "clGetEventProfilingInfo");
    return 1e-3 * static_cast<double>(nanoseconds);
  });
}

/// CL_COMPLETE, more while it is under way, and below zero the code of what went wrong.
cl_int status_of(const Launched& launched) {
  return asked_of(launched, [&] { return launched.event.getInfo<CL_EVENT_COMMAND_EXECUTION_STATUS>(); });
}

void account(Recorder& r, const Launched& launched) {
  const double begin = stamp_us(launched, CL_PROFILING_COMMAND_START);
  const double length = stamp_us(launched, CL_PROFILING_COMMAND_END) - begin;
  if (!r.device_to_host_us) r.device_to_host_us = launched.at_us - stamp_us(launched, CL_PROFILING_COMMAND_QUEUED);
  KernelCost& cost = r.kernels[launched.name];
  cost.calls++;
  cost.ms += 1e-3 * length;
  cost.flops += launched.flops;
  cost.bytes += launched.bytes;
  if (launched.in_step) r.step_device_us += length;
  if (r.timeline && r.spans.size() < kMaxSpans)
    r.spans.push_back({launched.name, begin + *r.device_to_host_us, length, true});
}

double per(double sum, int64_t steps) { return steps > 0 ? sum / static_cast<double>(steps) : 0; }

StepCost step_cost(const Recorder& r) {
  StepCost out;
  out.steps = std::max<int64_t>(0, r.steps - kWarmSteps);
  const DeviceStats &a = r.first.stats, &b = r.last.stats;
  out.ms = per(1e-3 * (r.last.at_us - r.first.at_us), out.steps);
  out.device_ms = per(1e-3 * r.step_device_us, out.steps);
  out.wait_ms = per(1e3 * (b.wait_seconds - a.wait_seconds), out.steps);
  out.launches = per(static_cast<double>(b.launches - a.launches), out.steps);
  out.waits = per(static_cast<double>(b.waits - a.waits), out.steps);
  out.allocated_bytes = per(static_cast<double>(b.allocated_bytes - a.allocated_bytes), out.steps);
  return out;
}

void write_span(std::ostream& out, const Span& span, double origin) {
  out << ",\n{\"ph\":\"X\",\"pid\":1,\"tid\":" << (span.on_device ? 2 : 1) << ",\"name\":\"" << span.name
      << "\",\"ts\":" << span.begin - origin << ",\"dur\":" << span.length << "}";
}

}  // namespace

bool profiling() {
  const DeviceLock lock;
  return profile_recorder().has_value();
}

void start_profile(bool keep_timeline) {
  const DeviceLock lock;
  if (profiling()) return;
  finish();
  ClDevice& cl = cl_device();
  cl.queue = called_again_with_room([] { return "make a queue that takes times"; },
                                    [&] { return cl::CommandQueue(cl.context, cl.device, CL_QUEUE_PROFILING_ENABLE); });
  profile_recorder().emplace();
  profile_recorder()->timeline = keep_timeline;
  profile_recorder()->began_us = host_us();
  profile_recorder()->began = device_stats();
}

void record_launch(cl::Event event, const char* name, double flops, double bytes) {
  Recorder& r = *profile_recorder();
  r.pending.push_back({std::move(event), name, flops, bytes, host_us(), r.steps >= kWarmSteps});
  if (r.pending.size() % 1024 == 0) collect_launches();
}

void collect_launches() {
  if (!profiling()) return;
  Recorder& r = *profile_recorder();
  while (!r.pending.empty()) {
    const cl_int status = status_of(r.pending.front());
    if (status > CL_COMPLETE) return;
    const Launched done = std::move(r.pending.front());
    r.pending.pop_front();
    if (status < 0) driver_failed(cl::Error(status, "its event"), text("run the kernel ", done.name));
    account(r, done);
  }
}

void profile_step() {
  const DeviceLock lock;
  if (!profiling()) return;
  Recorder& r = *profile_recorder();
  r.last = {host_us(), device_stats()};
  if (++r.steps == kWarmSteps) r.first = r.last;
}

Profile profile() {
  const DeviceLock lock;
  finish();
  collect_launches();
  const Recorder& r = *profile_recorder();
  Profile out;
  for (const auto& [name, cost] : r.kernels) {
    out.kernels.push_back(cost);
    out.kernels.back().name = name;
    out.device_seconds += 1e-3 * cost.ms;
  }
  std::sort(out.kernels.begin(), out.kernels.end(),
            [](const KernelCost& a, const KernelCost& b) { return a.ms > b.ms; });
  out.step = step_cost(r);
  out.seconds = 1e-6 * (host_us() - r.began_us);
  out.wait_seconds = device_stats().wait_seconds - r.began.wait_seconds;
  out.build_seconds = device_stats().build_seconds - r.began.build_seconds;
  return out;
}

std::string trace() {
  const DeviceLock lock;
  finish();
  collect_launches();
  std::ostringstream out;
  out << std::fixed;
  out.precision(3);
  out << R"({"displayTimeUnit":"ms","traceEvents":[
{"ph":"M","pid":1,"tid":1,"name":"thread_name","args":{"name":"host"}},
{"ph":"M","pid":1,"tid":2,"name":"thread_name","args":{"name":"device"}})";
  for (const Span& span : profile_recorder()->spans) write_span(out, span, profile_recorder()->began_us);
  out << "\n]}\n";
  return out.str();
}

HostSpan::HostSpan(const char* name)
    : name_(name), begin_(profiling() && profile_recorder()->timeline ? host_us() : 0) {}

HostSpan::~HostSpan() {
  if (begin_ == 0 || profile_recorder()->spans.size() >= kMaxSpans) return;
  try {
    profile_recorder()->spans.push_back({name_, begin_, host_us() - begin_, false});
  } catch (const std::bad_alloc&) {  // a span less in the picture
  }
}

}  // namespace cloam
