// See stop_signal.h.
#include "cli/stop_signal.h"

#include <unistd.h>

namespace cloam {

std::atomic<int> stop_signal{0};

namespace {

extern "C" void ask_to_stop(int signal) {
  if (stop_signal.load() != 0) _exit(128 + signal);
  stop_signal.store(signal);
}

}  // namespace

StopOnSignal::StopOnSignal() {
  stop_signal.store(0);
  struct sigaction action {};
  action.sa_handler = ask_to_stop;
  sigaction(SIGINT, &action, &old_interrupt_);
  sigaction(SIGTERM, &action, &old_terminate_);
}

StopOnSignal::~StopOnSignal() {
  sigaction(SIGINT, &old_interrupt_, nullptr);
  sigaction(SIGTERM, &old_terminate_, nullptr);
}

}  // namespace cloam
