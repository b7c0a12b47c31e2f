// Signals that ask the program to stop, for commands that have something to bring to an end first.
#pragma once
#include <atomic>
#include <csignal>
#include <stdexcept>
#include <string>

namespace cloam {

/// The signal that came since the last StopOnSignal began; 0: none.
extern std::atomic<int> stop_signal;

/// SIGINT, SIGTERM and SIGUSR1 (which mpirun passes on, and SLURM sends ahead of a limit) only set stop_signal and say
/// what happens next, as long as this lives; a second one ends the program at once.
class StopOnSignal {
 public:
  /// soon: what the program does before it stops, a literal; it follows "stopping: " on stderr. Null: it says nothing.
  explicit StopOnSignal(const char* soon);
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  struct sigaction old_interrupt_ {};
  struct sigaction old_terminate_ {};
  struct sigaction old_user_ {};
};

/// A command that was asked to stop and has: what() says what is complete and where.
class Interrupted : public std::runtime_error {
 public:
  Interrupted(int signal, const std::string& what) : std::runtime_error(what), signal_(signal) {}
  int signal() const { return signal_; }
  int code() const { return 128 + signal_; }

 private:
  int signal_;
};

/// Between two pictures. Throws Interrupted with what done() says is complete if a signal has come.
template <class Done>
void check_stop(const Done& done) {
  if (const int signal = stop_signal.load()) throw Interrupted(signal, "stopped: " + done());
}

}  // namespace cloam
