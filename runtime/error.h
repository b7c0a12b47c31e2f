// The one error type. Its fault decides the exit code of the program (docs/formats.md, "Exit codes").
#pragma once
#include <sstream>
#include <stdexcept>
#include <string>

namespace cloam {

enum class Fault {
  internal = 1,
  usage = 2,
  data = 3,
  device = 4,
  memory = 5,
  diverged = 6,
  verification = 7,
  write = 8
};

/// What went wrong, in one message that names what was looked for, what was found and how to mend it.
class Error : public std::runtime_error {
 public:
  Error(Fault fault, const std::string& message) : std::runtime_error(message), fault_(fault) {}
  Fault fault() const { return fault_; }

 private:
  Fault fault_;
};

/// Joins values into one string: text("need ", 3, " rows").
template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  out.precision(9);
  (out << ... << parts);
  return out.str();
}

/// Throws the error of files that are not as they should be: bad_data(path.string(), ": no points").
template <class... Parts>
[[noreturn]] void bad_data(const Parts&... parts) {
  throw Error(Fault::data, text(parts...));
}

}  // namespace cloam
