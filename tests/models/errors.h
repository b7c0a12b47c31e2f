// What went wrong, for tests that expect it.
#pragma once
#include <doctest/doctest.h>

#include <functional>
#include <string>

#include "runtime/error.h"

namespace cloam {

/// What the action's error says, which must be of that fault; "no error" if there is none.
inline std::string error_of(const std::function<void()>& action, Fault fault = Fault::data) {
  try {
    action();
  } catch (const Error& error) {
    CHECK(error.fault() == fault);
    return error.what();
  }
  return "no error";
}

inline bool holds(const std::string& all, const std::string& part) { return all.find(part) != std::string::npos; }

}  // namespace cloam
