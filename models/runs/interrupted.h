// Work that was asked to stop, and has.
#pragma once
#include <stdexcept>
#include <string>

namespace cloam {

/// what() says what is complete and where.
class Interrupted : public std::runtime_error {
 public:
  Interrupted(int signal, const std::string& what) : std::runtime_error(what), signal_(signal) {}
  int signal() const { return signal_; }
  int code() const { return 128 + signal_; }

 private:
  int signal_;
};

}  // namespace cloam
