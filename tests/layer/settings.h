// What the environment variable CLOAM_LAYER asks of the layer, comma-separated:
//   count=FILE              at exit, a line a function: its name and how often it was called
//   fail=FUNCTION:N[:CODE]  the N-th call (from 1) returns the error that a driver would give, or CODE; N+: and all
//                           later ones; N/M: and each M-th one after it
//   sticky                  after the first such call every call that needs the device fails (a lost device)
//   hang=FUNCTION:N         that call sleeps for an hour
//   profile=NAME            the limits and features of another device (profiles.cpp)
//   group=N                 with a profile: no more than N work-items in a group
//   memory=N                with a profile: no more than N MiB
//   version=N               with a profile: OpenCL N in the place of 1.2
#pragma once
#include <CL/cl.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace cloam::layer {

struct CallAt {
  std::string function;
  int64_t call = 1;   // from 1
  int64_t every = 0;  // and each so manieth call after it
  std::optional<cl_int> code;
  bool meets(int64_t number) const {
    return number == call || (every > 0 && number > call && (number - call) % every == 0);
  }
};

struct Settings {
  std::string count_file, profile, version = "1.2";
  std::vector<CallAt> failures, hangs;
  bool sticky = false;
  int64_t group = 0, memory = 0;  // 0: the profile's
};

/// Read once. Ends the process at a word that means nothing.
const Settings& settings();

/// Says why on stderr and ends the process with code 2: a test that asked for a fault must not pass without it.
[[noreturn]] void refuse(const std::string& why);

}  // namespace cloam::layer
