// Signals that ask the program to stop, for commands that have something to bring to an end first.
#pragma once
#include <atomic>
#include <csignal>

namespace cloam {

/// The signal that came since the last StopOnSignal began; 0: none.
extern std::atomic<int> stop_signal;

/// SIGINT and SIGTERM only set stop_signal, as long as this lives; a second one ends the program at once.
class StopOnSignal {
 public:
  StopOnSignal();
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  struct sigaction old_interrupt_ {};
  struct sigaction old_terminate_ {};
};

}  // namespace cloam
