// Private to runtime/: a device that does not answer ends the program with an error instead of letting it wait for
// ever.
#pragma once

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

}  // namespace cloam
