// Other programs that commands run: their output line by line, their life bound to ours.
#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace cloam {

/// Where PATH has a program; empty if nowhere.
std::filesystem::path find_program(const std::string& name);

struct ChildProgram {
  std::filesystem::path path;
  std::vector<std::string> arguments;
  std::vector<std::string> environment = {};  // "NAME=value" over our own
};

/// How a program ended: its exit code, or minus the signal that ended it, and the last lines that it printed.
struct ChildEnd {
  int code = 0;
  std::string said;  // "\n    line" each
  /// "ended with code 3; it printed: ...".
  std::string in_words() const;
  /// Whether it tells of a disk that is full.
  bool is_of_full_disk() const;
};

/// Runs it to its end. `seen` is called with each line of
/// its stdout and stderr. Once stop_signal (stop_signal.h) is set, the program and those that it started are ended. It
/// dies with us. Fault::internal if it cannot be started.
ChildEnd run_child(
    const ChildProgram& program, const std::function<void(const std::string& line)>& seen = [](const std::string&) {});

/// Starts it and lets it live on without us: it sees and says nothing. Nothing tells whether it could be started.
void start_apart(const ChildProgram& program);

}  // namespace cloam
