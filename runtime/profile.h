// What launches cost by the device's own clock. Off, it costs a test; on, it never waits for a launch: time stamps are
// read once a later wait has made them final.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace cloam {

struct KernelCost {
  std::string name;
  int64_t calls = 0;
  double ms = 0, flops = 0, bytes = 0;  // sums over the calls; bytes: those of the arguments, each once
};
/// Means over the steps after the first three, which compile.
struct StepCost {
  int64_t steps = 0;
  double ms = 0, device_ms = 0, wait_ms = 0;  // wait: the host blocked on the device
  double launches = 0, waits = 0, allocated_bytes = 0;
};
struct Profile {
  std::vector<KernelCost> kernels;  // the most time first
  StepCost step;
  double seconds = 0, device_seconds = 0, wait_seconds = 0, build_seconds = 0;
};

/// From here on launches are recorded; keep_timeline: each by itself, for trace().
void start_profile(bool keep_timeline = false);
bool profiling();
/// Says that a step of training (or a picture) is done.
void profile_step();
/// Everything so far. Waits for the device.
Profile profile();
/// The timeline as Chrome's trace events, which Perfetto and chrome://tracing show.
std::string trace();

/// What the host does from here to the end of the scope, as a span of the timeline.
class HostSpan {
 public:
  explicit HostSpan(const char* name);
  ~HostSpan();
  HostSpan(const HostSpan&) = delete;
  HostSpan& operator=(const HostSpan&) = delete;

 private:
  const char* name_;
  double begin_;
};

}  // namespace cloam
