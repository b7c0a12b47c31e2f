// What long work tells while it goes on, and how it is asked to stop.
#pragma once
#include <functional>
#include <string>

namespace cloam {

struct Listener {
  std::function<void(const std::string&)> say, warn;
  /// Called between two parts of the work. Throws if it is to end, with what done() says is complete.
  std::function<void(const std::function<std::string()>& done)> check_stop;
};

}  // namespace cloam
