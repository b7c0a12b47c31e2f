// Signals that ask the program to stop, for commands that have something to bring to an end first.
#pragma once
#include <atomic>
#include <csignal>
#include <string>

#include "models/runs/interrupted.h"

namespace cloam {

/// The signal that came since the last StopOnSignal began; 0: none.
extern std::atomic<int> stop_signal;

/// SIGINT, SIGTERM and SIGUSR1 (which mpirun passes on, and SLURM sends ahead of a limit) only set stop_signal and say
/// what happens next, as long as this lives; a second one ends the program at once.
class StopOnSignal {
 public:
  /// soon: what the program does before it stops, a literal; it follows "stopping: " on stderr. Null, or where another
  /// rank speaks: it says nothing.
  explicit StopOnSignal(const char* soon);
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  struct sigaction old_interrupt_ {};
  struct sigaction old_terminate_ {};
  struct sigaction old_user_ {};
};

/// Between two pictures. Throws Interrupted with what done() says is complete if a signal has come.
template <class Done>
void check_stop(const Done& done) {
  if (const int signal = stop_signal.load()) throw Interrupted(signal, "stopped: " + done());
}

}  // namespace cloam
