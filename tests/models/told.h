// What long work in models/ tells, for tests that read it or ask it to stop.
#pragma once
#include <string>

#include "models/runs/interrupted.h"
#include "models/runs/listener.h"

namespace cloam {

struct Told {
  std::string said, warned;  // a line each
  int stop_after = 1000000;  // questions whether to stop

  Listener listener() {
    return {[this](const std::string& line) { said += line + "\n"; },
            [this](const std::string& line) { warned += line + "\n"; },
            [this](const std::function<std::string()>& done) {
              if (--stop_after < 0) throw Interrupted(2, done());
            }};
  }
};

}  // namespace cloam
