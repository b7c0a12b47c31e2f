// Signals that ask the program to stop, for commands that have something to bring to an end first.
#pragma once
#include <array>
#include <atomic>
#include <csignal>
#include <string>

#include "models/runs/interrupted.h"

namespace cloam {

/// The signal that came since the last StopOnSignal began; 0: none.
extern std::atomic<int> stop_signal;

/// SIGINT, SIGTERM, SIGUSR1 (what SLURM sends ahead of a limit) and SIGUSR2 (what mpirun passes on: that of Open
/// MPI 4.1 keeps SIGUSR1 to itself) only set stop_signal and say what happens next, as long as this lives; a second one
/// ends the program at once.
class StopOnSignal {
 public:
  /// soon: what the program does before it stops, a literal; it follows "stopping: " on stderr. Null, or where another
  /// rank speaks: it says nothing.
  explicit StopOnSignal(const char* soon);
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  static constexpr std::array<int, 4> kSignals = {SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
  std::array<struct sigaction, kSignals.size()> old_{};
};

/// Between two pictures. Throws Interrupted with what done() says is complete if a signal has come.
template <class Done>
void check_stop(const Done& done) {
  if (const int signal = stop_signal.load()) throw Interrupted(signal, "stopped: " + done());
}

}  // namespace cloam
