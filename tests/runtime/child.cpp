// Runs one test case of this very program in a child process.
#include "tests/runtime/child.h"

#include <unistd.h>

#include <array>
#include <cstdio>
#include <stdexcept>

namespace cloam {

std::string output_of_child(const std::string& environment, const std::string& test_case) {
  std::array<char, 4096> buffer{};
  if (readlink("/proc/self/exe", buffer.data(), buffer.size() - 1) <= 0) throw std::runtime_error("no /proc/self/exe");
  const std::string command = environment + " '" + buffer.data() + "' --no-skip -tc='" + test_case + "' 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  if (!pipe) throw std::runtime_error("no child process");
  std::string out;
  while (std::fgets(buffer.data(), static_cast<int>(buffer.size()), pipe)) out += buffer.data();
  pclose(pipe);
  return out;
}

}  // namespace cloam
