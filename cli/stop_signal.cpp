// See stop_signal.h.
#include "cli/stop_signal.h"

#include <unistd.h>

#include <cstring>
#include <ctime>

#include "cli/common.h"

namespace cloam {

std::atomic<int> stop_signal{0};

namespace {

std::atomic<const char*> what_comes_first{""};

/// Only what may be called in a handler of signals.
void tell(const char* words) {
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, words, std::strlen(words));
}

/// Of a clock that any handler may read.
double seconds_now() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// One wish may arrive as several signals: `timeout` and job schedulers signal the process, then its group.
constexpr double kOneWish = 0.5;
std::atomic<double> asked_at{0};

extern "C" void ask_to_stop(int signal) {
  if (stop_signal.load() != 0) {
    if (seconds_now() - asked_at.load() < kOneWish) return;
    _exit(128 + signal);
  }
  stop_signal.store(signal);
  asked_at.store(seconds_now());
  if (!what_comes_first.load()) return;
  tell("\nstopping: ");  // a line may be open on a terminal
  tell(what_comes_first.load());
  tell("; press Ctrl-C again to quit at once\n");
}

}  // namespace

StopOnSignal::StopOnSignal(const char* soon) {
  stop_signal.store(0);
  what_comes_first.store(muted() ? nullptr : soon);
  struct sigaction action {};
  action.sa_handler = ask_to_stop;
  for (size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &old_[i]);
}

StopOnSignal::~StopOnSignal() {
  for (size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &old_[i], nullptr);
}

}  // namespace cloam
