// See driver.h.
#include "runtime/driver.h"

#include <algorithm>
#include <cstring>
#include <iterator>

#include "runtime/cl.h"

namespace cloam {
namespace {

struct Code {
  cl_int code;
  const char* name;
};

constexpr Code kCodes[] = {
    {-1, "CL_DEVICE_NOT_FOUND"},
    {-2, "CL_DEVICE_NOT_AVAILABLE"},
    {-3, "CL_COMPILER_NOT_AVAILABLE"},
    {-4, "CL_MEM_OBJECT_ALLOCATION_FAILURE"},
    {-5, "CL_OUT_OF_RESOURCES"},
    {-6, "CL_OUT_OF_HOST_MEMORY"},
    {-7, "CL_PROFILING_INFO_NOT_AVAILABLE"},
    {-8, "CL_MEM_COPY_OVERLAP"},
    {-11, "CL_BUILD_PROGRAM_FAILURE"},
    {-12, "CL_MAP_FAILURE"},
    {-13, "CL_MISALIGNED_SUB_BUFFER_OFFSET"},
    {-14, "CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST"},
    {-15, "CL_COMPILE_PROGRAM_FAILURE"},
    {-16, "CL_LINKER_NOT_AVAILABLE"},
    {-17, "CL_LINK_PROGRAM_FAILURE"},
    {-18, "CL_DEVICE_PARTITION_FAILED"},
    {-30, "CL_INVALID_VALUE"},
    {-31, "CL_INVALID_DEVICE_TYPE"},
    {-32, "CL_INVALID_PLATFORM"},
    {-33, "CL_INVALID_DEVICE"},
    {-34, "CL_INVALID_CONTEXT"},
    {-35, "CL_INVALID_QUEUE_PROPERTIES"},
    {-36, "CL_INVALID_COMMAND_QUEUE"},
    {-37, "CL_INVALID_HOST_PTR"},
    {-38, "CL_INVALID_MEM_OBJECT"},
    {-42, "CL_INVALID_BINARY"},
    {-43, "CL_INVALID_BUILD_OPTIONS"},
    {-44, "CL_INVALID_PROGRAM"},
    {-45, "CL_INVALID_PROGRAM_EXECUTABLE"},
    {-46, "CL_INVALID_KERNEL_NAME"},
    {-47, "CL_INVALID_KERNEL_DEFINITION"},
    {-48, "CL_INVALID_KERNEL"},
    {-49, "CL_INVALID_ARG_INDEX"},
    {-50, "CL_INVALID_ARG_VALUE"},
    {-51, "CL_INVALID_ARG_SIZE"},
    {-52, "CL_INVALID_KERNEL_ARGS"},
    {-53, "CL_INVALID_WORK_DIMENSION"},
    {-54, "CL_INVALID_WORK_GROUP_SIZE"},
    {-55, "CL_INVALID_WORK_ITEM_SIZE"},
    {-56, "CL_INVALID_GLOBAL_OFFSET"},
    {-57, "CL_INVALID_EVENT_WAIT_LIST"},
    {-58, "CL_INVALID_EVENT"},
    {-59, "CL_INVALID_OPERATION"},
    {-61, "CL_INVALID_BUFFER_SIZE"},
    {-63, "CL_INVALID_GLOBAL_WORK_SIZE"},
    {-64, "CL_INVALID_PROPERTY"},
    {-1001, "CL_PLATFORM_NOT_FOUND_KHR"},
    {-9999, "an illegal access to memory, in NVIDIA's driver"},
};

bool is_memory(const cl::Error& error) {
  const cl_int code = error.err();
  if (code == CL_OUT_OF_RESOURCES)  // of a read: that of a launch before it
    return std::strstr(error.what(), "Buffer") && !std::strstr(error.what(), "Read");
  return code == CL_MEM_OBJECT_ALLOCATION_FAILURE || code == CL_OUT_OF_HOST_MEMORY || code == CL_INVALID_BUFFER_SIZE ||
         code == CL_MAP_FAILURE;
}

bool still_answers() {
  const Watched watched;
  return clFinish(cl_device().queue()) == CL_SUCCESS;
}

std::string device_advice(bool of_resources) {
  const char* const less = of_resources ? "smaller --set batch.* need less of the device; " : "";
  return text("fix: ", less,
              "cloam selftest --quick checks the device; if it fails too, update the driver, restart the "
              "computer, or select another device: cloam info lists them");
}

std::string answer(const cl::Error& error) { return text(error.what(), " gave ", code_text(error.err())); }

std::string memory_advice() {
  const DeviceStats& s = device_stats();
  return text(
      "in use: ", s.live_bytes >> 20, " MiB of a budget of ", memory_budget() >> 20,
      " MiB\n  fix: train with a larger --downscale or smaller --set batch.*, close other programs that use the "
      "device; a smaller --max-memory refuses earlier what does not fit");
}

}  // namespace

std::string code_text(cl_int code) {
  const auto* const found =
      std::find_if(std::begin(kCodes), std::end(kCodes), [&](const Code& c) { return c.code == code; });
  return found == std::end(kCodes) ? text("the code ", code) : text(found->name, " (", code, ")");
}

void driver_failed(const cl::Error& error, const std::string& doing) {
  const bool answers = still_answers();
  std::string message = text("cannot ", doing, ": ", answer(error), " on ", device().name, " (", device().platform,
                             ", driver ", device().driver, ")");
  if (!answers) message += "\n  the device no longer answers: it was reset or lost, or a kernel made it crash";
  const bool of_memory = answers && is_memory(error), of_resources = answers && error.err() == CL_OUT_OF_RESOURCES;
  message += "\n  " + (of_memory ? memory_advice() : device_advice(of_resources));
  throw Error(of_memory ? Fault::memory : Fault::device, message);
}

void opening_failed(const cl::Error& error, const std::string& doing, const std::string& where) {
  throw Error(Fault::device, text("cannot ", doing, ": ", answer(error), " on ", where, "\n  ", device_advice(false)));
}

bool room_may_help(cl_int code) {
  return code == CL_OUT_OF_RESOURCES || code == CL_MEM_OBJECT_ALLOCATION_FAILURE || code == CL_OUT_OF_HOST_MEMORY ||
         code == CL_MAP_FAILURE;
}

}  // namespace cloam
