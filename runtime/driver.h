// Private to runtime/: how the OpenCL driver is called. What it refuses becomes an Error here and nowhere else: no
// cl::Error leaves runtime/.
#pragma once
#include <CL/opencl.hpp>
#include <string>

#include "runtime/error.h"
#include "runtime/watchdog.h"

namespace cloam {

/// "CL_OUT_OF_RESOURCES (-5)"; codes that no header names stand as their number.
std::string code_text(cl_int code);
/// Throws the Error of a call that failed: Fault::memory where less of it would have done, else Fault::device. `doing`
/// completes "cannot ...", such as "read 64 bytes of a buffer". Waits for the queue first, as far as it still answers:
/// what is in flight does not outlive what it uses.
[[noreturn]] void driver_failed(const cl::Error& error, const std::string& doing);
/// The same before there is a device of this process: `where` names the one that was tried.
[[noreturn]] void opening_failed(const cl::Error& error, const std::string& doing, const std::string& where);

/// Whether a call that gave this code may do better once the device is idle and has free memory.
bool room_may_help(cl_int code);
/// Waits for what is launched and gives free buffers back. False: the device does not answer any more.
bool make_room();

/// Calls the driver; doing() gives the words for driver_failed, and is asked only then.
template <class Doing, class Call>
auto called(const Doing& doing, const Call& call) {
  try {
    const Watched watched;
    return call();
  } catch (const cl::Error& error) { driver_failed(error, doing()); }
}

/// The same for calls that take memory or put work into the queue: where the driver lacks room, it is made, and the
/// call is repeated once. Never for waits and reads: their fault may be that of earlier work, whose results are lost.
template <class Doing, class Call>
auto called_again_with_room(const Doing& doing, const Call& call) {
  try {
    const Watched watched;
    return call();
  } catch (const cl::Error& error) {
    if (!room_may_help(error.err()) || !make_room()) driver_failed(error, doing());
  }
  return called(doing, call);
}

/// The kernels launched last, the newest first, separated by commas: what a wait may have failed for.
std::string last_launches();

}  // namespace cloam
