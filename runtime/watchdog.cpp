// See watchdog.h. A thread looks every quarter of a second which call of the driver is under way. One that lasts is no
// fault by itself: a device on the host's cores is at work as long as this process uses the processor or reads pages
// back, whatever it takes. Of other devices nothing is seen (some drivers spin while they wait), so they get longer.
#include "runtime/watchdog.h"

#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "runtime/device.h"
#include "runtime/driver.h"

namespace cloam {
namespace {

constexpr double kTick = 0.25;                     // seconds between looks
constexpr double kOnCores = 30, kElsewhere = 120;  // seconds without a sign
constexpr double kAtWork = 0.01;                   // of a processor, at least

struct WatchState {
  std::atomic<uint64_t> call{0};  // the number of the one under way; 0: none
  std::atomic<bool> compiling{false};
  uint64_t calls = 0;  // of the thread that calls the driver
  std::mutex mutex;
  std::function<void(const std::string&)> listener;
};
WatchState& state() {
  static WatchState* const one = new WatchState;  // outlives the thread, which is never joined
  return *one;
}

/// What grows while this process is at work.
struct Effort {
  double seconds = 0;  // of processors
  int64_t pages = 0;   // read back from disks
};

Effort effort() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(usage.ru_utime) + seconds(usage.ru_stime), usage.ru_majflt};
}

std::string number(double seconds) { return text(std::round(10 * seconds) / 10); }

[[noreturn]] void give_up(double seconds) {
  const std::string message =
      text("the device has not answered for ", number(seconds), " s: ", device().name, " (", device().platform,
           ", driver ", device().driver, ")\n  launched last, the newest first: ", last_launches(),
           "\n  fix: cloam selftest --quick checks the device; restart the computer if it hangs, too. "
           "CLOAM_WATCHDOG=SECONDS waits longer, 0 for ever");
  const std::scoped_lock lock(state().mutex);
  if (state().listener)
    state().listener(message);
  else
    std::fprintf(stderr, "error: %s\n", message.c_str());
  _exit(static_cast<int>(Fault::device));
}

/// Time is counted in looks: a program that is stopped (Ctrl-Z) does not look either.
[[noreturn]] void watch(bool on_cores, double limit) {
  uint64_t before = 0;
  Effort spent = effort();
  for (double silent = 0;;) {
    std::this_thread::sleep_for(std::chrono::duration<double>(kTick));
    const uint64_t call = state().call.load(std::memory_order_acquire);
    const Effort now = effort();
    const bool works = now.seconds - spent.seconds > kAtWork * kTick || now.pages > spent.pages;
    const bool sign = call == 0 || call != before || ((on_cores || state().compiling) && works);
    silent = sign ? 0 : silent + kTick;
    before = call;
    spent = now;
    if (silent >= limit) give_up(silent);
  }
}

/// Seconds; 0: never.
double wanted_limit(bool on_cores) {
  const char* given = std::getenv("CLOAM_WATCHDOG");
  if (!given || !*given) return on_cores ? kOnCores : kElsewhere;
  char* end = nullptr;
  const double seconds = std::strtod(given, &end);
  if (*end || !(seconds >= 0))
    throw Error(Fault::usage, text("CLOAM_WATCHDOG=", given, ": want seconds, such as 60, or 0 to wait for ever"));
  return seconds;
}

}  // namespace

Watched::Watched() noexcept { state().call.store(++state().calls, std::memory_order_release); }
Watched::~Watched() { state().call.store(0, std::memory_order_release); }

WatchedBuild::WatchedBuild() noexcept { state().compiling = true; }
WatchedBuild::~WatchedBuild() { state().compiling = false; }

void start_watchdog(bool on_cores) {
  const double limit = wanted_limit(on_cores);
  if (limit == 0) return;
  try {
    std::thread([on_cores, limit] { watch(on_cores, limit); }).detach();
  } catch (const std::system_error&) {  // no thread to be had: then nobody watches
  }
}

std::function<void(const std::string&)> on_hang(std::function<void(const std::string&)> listener) {
  const std::scoped_lock lock(state().mutex);
  return std::exchange(state().listener, std::move(listener));
}

}  // namespace cloam
