// A device that does not answer ends the program with an error instead of letting it wait for ever. The program takes
// on_hang() from here; the rest is private to runtime/.
#pragma once
#include <functional>
#include <string>

namespace cloam {

/// Lives as long as a call of the driver.
class Watched {
 public:
  Watched() noexcept;
  ~Watched();
  Watched(const Watched&) = delete;
  Watched& operator=(const Watched&) = delete;
};

/// The same of calls that compile: those are at work as long as this process uses the processor, on any device.
class WatchedBuild {
 public:
  WatchedBuild() noexcept;
  ~WatchedBuild();
  WatchedBuild(const WatchedBuild&) = delete;
  WatchedBuild& operator=(const WatchedBuild&) = delete;
};

/// Begins to watch, for a device on this host's cores or another. Fault::usage if CLOAM_WATCHDOG is no number.
void start_watchdog(bool on_cores);

/// What is told when the device has not answered for CLOAM_WATCHDOG seconds (30 without a sign of work on a device on
/// the host's cores, else 120), on a thread of its own; then the program ends with Fault::device as its code. Without a
/// listener the message goes to stderr. Gives the listener before.
std::function<void(const std::string&)> on_hang(std::function<void(const std::string&)> listener);

}  // namespace cloam
