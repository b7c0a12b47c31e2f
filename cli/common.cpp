// See common.h.
#include "cli/common.h"

#include <fmt/chrono.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <utility>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/ranks.h"
#include "cli/stop_signal.h"
#include "models/io/draw_text.h"
#include "models/runs/restore_run.h"
#include "runtime/error.h"
#include "runtime/kernel_cache.h"
#include "runtime/variant.h"
#include "runtime/verdict.h"

namespace cloam {
namespace {

const auto kLoaded = std::chrono::steady_clock::now();

/// When the kernel started this process, in seconds since boot; it counts the loading of the libraries too.
double start_time() {
  std::ifstream file("/proc/self/stat");
  std::string content((std::istreambuf_iterator<char>(file)), {});
  const std::size_t name_end = content.rfind(')');  // the name may hold spaces
  if (name_end == std::string::npos) return -1;
  std::istringstream fields(content.substr(name_end + 1));
  std::string field;
  for (int i = 3; i <= 22; ++i) fields >> field;  // field 22 of proc(5): clock ticks since boot
  const double ticks = static_cast<double>(sysconf(_SC_CLK_TCK));
  return field.empty() ? -1 : std::strtod(field.c_str(), nullptr) / ticks;
}

/// The number at the front of `rest`, which is moved past it; negative if there is none.
double take_number(std::string_view& rest) {
  double value = -1;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return -1;
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  return value;
}

}  // namespace

namespace {

/// A first run compiles for many seconds in which nothing else can be shown; drivers keep what was compiled. On a
/// terminal a line is rewritten; elsewhere one says that it began and one, before the next news, that it is done.
struct BuildNews {
  double seen = 0, compiling = 0;  // seconds of all builds so far; of those that the driver did not have
  int64_t built = 0, kernels = 0;  // in all builds so far, in those
  bool compiled = false;           // so was the last one
  double from = 1;                 // seconds of compiling that are news
  bool open = false;

  void tell(const DeviceStats& stats) {
    constexpr double kKept = 0.15;  // seconds: PoCL looks up in 0.03 what takes it half a second to compile
    const double took = stats.build_seconds - std::exchange(seen, stats.build_seconds);
    count_last(stats);
    compiled = took > kKept;
    if (compiled) compiling += took;
    if (compiling < from) return;
    if (isatty(STDERR_FILENO)) {
      std::fprintf(stderr, "\rcompiling kernels: %lld, kept for the next run \033[K\r",
                   static_cast<long long>(kernels));
    } else if (!std::exchange(open, true)) {
      std::fprintf(stderr, "compiling kernels for this device (kept for the next run) ...\n");
    }
  }
  /// The kernels of a build are counted after it was told.
  void count_last(const DeviceStats& stats) {
    const int64_t more = stats.kernels_built - std::exchange(built, stats.kernels_built);
    if (compiled) kernels += more;
  }
  void end() {
    if (!std::exchange(open, false)) return;
    count_last(device_stats());
    compiled = false;
    std::fprintf(stderr, "compiled %lld kernels in %s\n", static_cast<long long>(kernels),
                 words_for_seconds(compiling).c_str());
    from = compiling + 1;
  }
};

BuildNews& build_news() {
  static BuildNews news;
  return news;
}

void tell_of_builds(const Common& common) {
  if (common.quiet || common.json || muted()) return;
  on_build([](const DeviceStats& stats) { build_news().tell(stats); });
}

}  // namespace

namespace {

/// What selftest found of the device, once a process: a demo opens it for each of its commands.
void heed_verdict(const Common& common) {
  static bool heeded = false;
  const std::optional<Verdict> verdict = verdict_of(device());
  if (!verdict || std::exchange(heeded, true)) return;
  std::vector<std::string> families;
  for (const SwitchedOff& off : verdict->off) {
    families.push_back(off.family);
    say(common, text("the faster kernels of ", off.family,
                     " are switched off on this device: selftest found them wrong (row ", off.op_row, ")"));
  }
  switch_off(families);
  if (verdict->passed()) return;
  const std::string found =
      text("device ", device().name, " ", words_of(verdict), ", first \"", verdict->failed.front(), "\"");
  if (common.force) return warn(found + "; used all the same (--force)");
  throw Error(Fault::device, text(found,
                                  ": its results would be wrong\n  fix: update its driver and run cloam selftest "
                                  "--quick, or select another device (cloam info); --force uses it all the same"));
}

}  // namespace

namespace {

/// Options that others gave the compiler may change results, and what selftest found of the device is told without
/// them.
void warn_of_build_flags() {
  static bool warned = false;
  for (const char* name : {"POCL_EXTRA_BUILD_FLAGS", "CLOAM_BUILD_OPTIONS"})
    if (const char* flags = std::getenv(name); flags && *flags && !std::exchange(warned, true))
      warn(text(name, "=", flags, " changes how kernels are compiled: results can differ from those without it"));
}

bool is_pocl() { return !device().pinning.empty(); }

/// PoCL ends the program where it finds none. A driver that needs none, or kernels that are kept, go on.
void warn_of_missing_linker() {
  static bool warned = false;
  if (is_pocl() && find_program("ld").empty() && !std::exchange(warned, true))
    warn(text(
        "no ld in PATH, with which ", device().platform,
        " links kernels: if the program ends with a signal now, sudo apt install binutils, or add the folder of ld "
        "to PATH"));
}

}  // namespace

void open_device(const Common& common) {
  open_any_device(common);
  heed_verdict(common);
  warn_of_build_flags();
  check_devices_alike();
}

void open_any_device(const Common& common) {
  tell_of_builds(common);
  choose_device({common.device, common.max_memory.empty() ? 0 : parse_bytes(common.max_memory)});
  if (common.require_gpu && device().is_cpu)
    throw Error(Fault::device, text("--require-gpu: the device is a CPU (", device().name, ", ", device().platform,
                                    ")\n  fix: install the GPU's OpenCL driver; cloam info lists the devices"));
  static bool told = false;  // a demo opens the device for each of its commands
  if (!told && is_pocl() && !kernel_cache().note.empty()) say(common, kernel_cache().note);
  told = true;
  warn_of_missing_linker();
  begin_profile(common);
}

RestoredRun restored(const std::string& run, const Common& common) {
  open_device(common);
  RestoredRun found = restore_run(run);
  if (!found.checkpoint.warning.empty()) warn(found.checkpoint.warning);
  return found;
}

void end_build_news() { build_news().end(); }

namespace {
bool is_muted = false;
}

void mute() { is_muted = true; }
bool muted() { return is_muted; }

void say(const Common& common, const std::string& line) {
  end_build_news();
  if (!common.quiet && !muted()) std::fprintf(stderr, "%s\n", line.c_str());
}

void warn(const std::string& warning) {
  if (muted()) return;
  end_build_news();
  std::fprintf(stderr, "warning: %s\n", warning.c_str());
}

void warn_without_font() {
  if (!can_draw_text())
    warn("the sheet has no captions: the font DejaVu Sans is not installed (apt-get install fonts-dejavu-core)");
}

Listener listener_of(const Common& common) {
  return {[&common](const std::string& line) { say(common, line); }, warn,
          [](const std::function<std::string()>& done) { check_stop(done); }};
}

void put(std::string_view data) {
  if (muted()) return;
  end_build_news();
  const bool written = std::fwrite(data.data(), 1, data.size(), stdout) == data.size();
  if (!written || std::fflush(stdout) != 0)
    throw Error(Fault::write, text("cannot write to standard output: ", std::strerror(errno)));
}

void put_json(const nlohmann::ordered_json& json, int indent) {
  put(json.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

double parse_duration(const std::string& given) {
  std::string_view rest = given;
  double seconds = 0;
  while (!rest.empty()) {
    const double value = take_number(rest);
    const char unit = rest.empty() ? 's' : rest.front();
    const double factor = unit == 's' ? 1 : unit == 'm' ? 60 : unit == 'h' ? 3600 : -1;
    if (value < 0 || factor < 0)
      throw Error(Fault::usage, text("\"", given, "\" is not a duration: want 90s, 5m or 1h30m"));
    seconds += value * factor;
    if (!rest.empty()) rest.remove_prefix(1);
  }
  if (seconds <= 0)
    throw Error(Fault::usage, text("\"", given, "\" is not a positive duration: want 90s, 5m or 1h30m"));
  return seconds;
}

ImageSize parse_size(const std::string& given) {
  constexpr int kLargestSide = 1 << 14;
  const auto is_side = [](int side) { return side >= 1 && side <= kLargestSide; };
  int width = 0, height = 0, length = 0;
  const bool whole = std::sscanf(given.c_str(), "%5dx%5d%n", &width, &height, &length) == 2 &&
                     length == static_cast<int>(given.size());
  if (whole && is_side(width) && is_side(height)) return {width, height};
  throw Error(
      Fault::usage,
      text("--size ", given, ": want WIDTHxHEIGHT in pixels, such as 640x360, with sides of at most ", kLargestSide));
}

uint64_t parse_bytes(const std::string& given) {
  std::string_view rest = given;
  const double value = take_number(rest);
  const std::string_view units = "KMGT";
  double factor = 1;
  if (!rest.empty()) {
    const std::size_t place = units.find(static_cast<char>(std::toupper(static_cast<unsigned char>(rest.front()))));
    factor = place == std::string_view::npos ? -1 : std::pow(1024.0, static_cast<double>(place) + 1);
    rest.remove_prefix(1);
  }
  const bool ended = rest.empty() || rest == "B" || rest == "iB";
  if (value <= 0 || factor < 0 || !ended || value * factor > 1e18) {
    throw Error(Fault::usage, text("\"", given, "\" is not a size: want 600M or 6G"));
  }
  if (factor == 1 && value < 1 << 20)  // the unit was forgotten
    throw Error(Fault::usage, text("\"", given, "\" is ", given, " bytes: want 600M or 6G"));
  return static_cast<uint64_t>(value * factor);
}

std::string clock_after(double seconds) {
  const std::time_t when = std::time(nullptr) + static_cast<std::time_t>(seconds);
  return fmt::format(fmt::runtime(seconds > 20 * 3600 ? "{:%a %H:%M}" : "{:%H:%M}"), fmt::localtime(when));
}

namespace {

double& restarted() {
  static double seconds = 0;  // after the program's start
  return seconds;
}

double seconds_since_program_start() {
  static const double started = start_time();
  timespec now{};
  const double since_load = std::chrono::duration<double>(std::chrono::steady_clock::now() - kLoaded).count();
  if (started < 0 || clock_gettime(CLOCK_BOOTTIME, &now) != 0) return since_load;
  return std::max(since_load, static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec) - started);
}

}  // namespace

double seconds_since_start() { return seconds_since_program_start() - restarted(); }

void restart_clock() { restarted() = seconds_since_program_start(); }

std::string device_spelling(const DeviceInfo& info) { return text("--device ", info.id, " or CLOAM_DEVICE=", info.id); }

std::string& command_line() {
  static std::string line;
  return line;
}

}  // namespace cloam
