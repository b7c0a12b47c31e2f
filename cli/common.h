// What all commands share: the options every one has, talk on stderr, data on stdout, words for numbers.
#pragma once
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "models/io/image.h"
#include "models/io/words.h"
#include "models/runs/listener.h"
#include "models/runs/version.h"
#include "runtime/device.h"

namespace CLI {
class App;
}

namespace cloam {

namespace fs = std::filesystem;
struct RestoredRun;

struct Common {
  std::string device = "auto";
  std::string max_memory;  // "6G"; empty: 80 % of what is free
  bool json = false, quiet = false, verbose = false;
  bool require_gpu = false;  // an error instead of a CPU
  bool force = false;        // use a device that selftest found wrong
  bool profile = false;
  std::string profile_trace;  // file; empty: none
};

/// A sub-command: how it is parsed and what it does. run returns the exit code.
struct Command {
  CLI::App* parser = nullptr;
  std::function<int()> run;
};

void add_common(CLI::App& parser, Common& common);
/// Chooses the device and the memory budget, and switches off the kernels that selftest found wrong on it. A device
/// that computes wrong results is refused, unless --force is given. Fault::device, Fault::usage.
void open_device(const Common& common);
/// The same, whatever selftest found.
void open_any_device(const Common& common);
/// Opens the device and restores a run. Tells what is odd of its checkpoint.
RestoredRun restored(const std::string& run, const Common& common);

/// From here on nothing is said on stderr and nothing put on stdout but how a failure ends the program: another rank
/// speaks for this one.
void mute();
bool muted();
/// A line on stderr, unless -q.
void say(const Common& common, const std::string& line);
void warn(const std::string& warning);
/// Of a sheet of pictures that was to have captions.
void warn_without_font();
/// say, warn and check_stop, for long work in models/.
Listener listener_of(const Common& common);
/// Says that compiling is done, if it was said that it began: before news that do not go through say().
void end_build_news();
/// Data on stdout, at once. Fault::write if it cannot be written.
void put(std::string_view data);
/// A line of JSON, or several with that indentation.
void put_json(const nlohmann::ordered_json& json, int indent = -1);

/// "90", "90s", "5m", "1h30m" -> seconds. Fault::usage.
double parse_duration(const std::string& text);
/// "320x180" -> width and height, as --size has them. Fault::usage.
ImageSize parse_size(const std::string& text);
/// "600M", "6G" -> bytes. Fault::usage.
uint64_t parse_bytes(const std::string& text);
/// "14:05", the local time that many seconds from now.
std::string clock_after(double seconds);
/// Since the program was started (not since main was reached).
double seconds_since_start();
/// --device and CLOAM_DEVICE that choose this device again.
std::string device_spelling(const DeviceInfo& info);
/// The command line as typed, in quotes where a shell needs them.
std::string& command_line();

/// --profile and --profile-trace: what each kernel and each step cost.
/// Begins to record if the options ask for it. The device must be open.
void begin_profile(const Common& common);
/// Tells it on stderr and writes the trace. Nothing when no profile was begun. Fault::write.
void end_profile();

}  // namespace cloam
