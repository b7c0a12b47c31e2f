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

/// Runs it to its end and returns its exit code, or minus the signal that ended it. `seen` is called with each line of
/// its stdout and stderr. Once stop_signal (stop_signal.h) is set, the program and those that it started are ended. It
/// dies with us. Fault::internal if it cannot be started.
int run_child(const ChildProgram& program, const std::function<void(const std::string& line)>& seen);

/// Whether a program that failed tells of a disk that is full.
bool is_of_full_disk(const std::string& said);

}  // namespace cloam
