// One wrapper for all functions, made from the type of their place in the dispatch table; one row a function says what
// a driver returns when it fails.
#include "tests/layer/faults.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <thread>
#include <tuple>
#include <type_traits>
#include <vector>

#include "tests/layer/settings.h"

namespace cloam::layer {
namespace {

struct Function {
  const char* name = nullptr;
  cl_int error = CL_SUCCESS;
  bool needs_device = true;  // fails once the device is lost
  std::vector<CallAt> failures, hangs;
  std::atomic<int64_t> calls{0};
};

// Objects here are never destroyed: a program releases what it holds after its libraries' own statics are gone.
cl_icd_dispatch below;
std::vector<Function*>& functions = *new std::vector<Function*>;
std::atomic<bool> device_lost{false};

/// Counts the call; the error that it is to return instead of being made, if any.
std::optional<cl_int> fault_of(Function& function) {
  const int64_t call = ++function.calls;
  for (const CallAt& hang : function.hangs)
    if (hang.meets(call)) std::this_thread::sleep_for(std::chrono::hours(1));
  if (device_lost && function.needs_device) return CL_OUT_OF_RESOURCES;
  for (const CallAt& failure : function.failures)
    if (failure.meets(call)) {
      if (settings().sticky) device_lost = true;
      return failure.code.value_or(function.error);
    }
  return std::nullopt;
}

/// What a failed call returns: the error itself, or null and the error through the last argument.
template <class Result, class... Arguments>
Result failed(cl_int error, [[maybe_unused]] Arguments... arguments) {
  if constexpr (std::is_same_v<Result, cl_int>) {
    return error;
  } else {
    cl_int* const error_ret = std::get<sizeof...(Arguments) - 1>(std::make_tuple(arguments...));
    if (error_ret) *error_ret = error;
    return nullptr;
  }
}

template <auto Member>
struct Wrapped;

template <class Result, class... Arguments, Result (CL_API_CALL* cl_icd_dispatch::*Member)(Arguments...)>
struct Wrapped<Member> {
  static inline Function& function = *new Function;
  static Result CL_API_CALL call(Arguments... arguments) {
    if (const std::optional<cl_int> error = fault_of(function)) return failed<Result>(*error, arguments...);
    return (below.*Member)(arguments...);
  }
};

template <auto Member>
void wrap(cl_icd_dispatch& layer, const char* name, cl_int error, bool needs_device = true) {
  Function& function = Wrapped<Member>::function;
  function.name = name;
  function.error = error;
  function.needs_device = needs_device;
  for (const CallAt& failure : settings().failures)
    if (failure.function == name) function.failures.push_back(failure);
  for (const CallAt& hang : settings().hangs)
    if (hang.function == name) function.hangs.push_back(hang);
  functions.push_back(&function);
  layer.*Member = Wrapped<Member>::call;
}

using Table = cl_icd_dispatch;

void wrap_objects(Table& t) {
  constexpr cl_int kNoMemory = CL_OUT_OF_HOST_MEMORY, kResources = CL_OUT_OF_RESOURCES;
  wrap<&Table::clGetPlatformIDs>(t, "clGetPlatformIDs", -1001, false);  // CL_PLATFORM_NOT_FOUND_KHR
  wrap<&Table::clGetDeviceIDs>(t, "clGetDeviceIDs", CL_DEVICE_NOT_FOUND, false);
  wrap<&Table::clCreateContext>(t, "clCreateContext", CL_DEVICE_NOT_AVAILABLE);
  wrap<&Table::clCreateCommandQueue>(t, "clCreateCommandQueue", kNoMemory);
  wrap<&Table::clCreateBuffer>(t, "clCreateBuffer", CL_MEM_OBJECT_ALLOCATION_FAILURE);
  wrap<&Table::clCreateSubBuffer>(t, "clCreateSubBuffer", CL_MEM_OBJECT_ALLOCATION_FAILURE);
  wrap<&Table::clCreateProgramWithSource>(t, "clCreateProgramWithSource", kNoMemory);
  wrap<&Table::clBuildProgram>(t, "clBuildProgram", CL_BUILD_PROGRAM_FAILURE);
  wrap<&Table::clCreateKernel>(t, "clCreateKernel", kResources);
  wrap<&Table::clSetKernelArg>(t, "clSetKernelArg", kResources);
  wrap<&Table::clCreateUserEvent>(t, "clCreateUserEvent", kResources);
}

void wrap_queries(Table& t) {
  constexpr cl_int kNoMemory = CL_OUT_OF_HOST_MEMORY;
  wrap<&Table::clGetPlatformInfo>(t, "clGetPlatformInfo", kNoMemory, false);
  wrap<&Table::clGetDeviceInfo>(t, "clGetDeviceInfo", kNoMemory, false);
  wrap<&Table::clGetContextInfo>(t, "clGetContextInfo", kNoMemory);
  wrap<&Table::clGetCommandQueueInfo>(t, "clGetCommandQueueInfo", kNoMemory);
  wrap<&Table::clGetMemObjectInfo>(t, "clGetMemObjectInfo", kNoMemory);
  wrap<&Table::clGetProgramInfo>(t, "clGetProgramInfo", kNoMemory);
  wrap<&Table::clGetProgramBuildInfo>(t, "clGetProgramBuildInfo", kNoMemory);
  wrap<&Table::clGetKernelInfo>(t, "clGetKernelInfo", kNoMemory);
  wrap<&Table::clGetKernelWorkGroupInfo>(t, "clGetKernelWorkGroupInfo", kNoMemory);
  wrap<&Table::clGetEventInfo>(t, "clGetEventInfo", kNoMemory);
  wrap<&Table::clGetEventProfilingInfo>(t, "clGetEventProfilingInfo", CL_PROFILING_INFO_NOT_AVAILABLE);
}

void wrap_commands(Table& t) {
  constexpr cl_int kResources = CL_OUT_OF_RESOURCES;
  wrap<&Table::clEnqueueNDRangeKernel>(t, "clEnqueueNDRangeKernel", kResources);
  wrap<&Table::clEnqueueReadBuffer>(t, "clEnqueueReadBuffer", kResources);
  wrap<&Table::clEnqueueWriteBuffer>(t, "clEnqueueWriteBuffer", kResources);
  wrap<&Table::clEnqueueCopyBuffer>(t, "clEnqueueCopyBuffer", kResources);
  wrap<&Table::clEnqueueFillBuffer>(t, "clEnqueueFillBuffer", kResources);
  wrap<&Table::clEnqueueMapBuffer>(t, "clEnqueueMapBuffer", CL_MAP_FAILURE);
  wrap<&Table::clEnqueueUnmapMemObject>(t, "clEnqueueUnmapMemObject", kResources);
  wrap<&Table::clEnqueueMarkerWithWaitList>(t, "clEnqueueMarkerWithWaitList", kResources);
  wrap<&Table::clEnqueueBarrierWithWaitList>(t, "clEnqueueBarrierWithWaitList", kResources);
  wrap<&Table::clFlush>(t, "clFlush", kResources);
  wrap<&Table::clFinish>(t, "clFinish", kResources);
  wrap<&Table::clWaitForEvents>(t, "clWaitForEvents", CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST);
}

/// These work on a lost device: only the host's books change.
void wrap_references(Table& t) {
  constexpr cl_int kResources = CL_OUT_OF_RESOURCES;
  wrap<&Table::clRetainDevice>(t, "clRetainDevice", kResources, false);
  wrap<&Table::clReleaseDevice>(t, "clReleaseDevice", kResources, false);
  wrap<&Table::clRetainContext>(t, "clRetainContext", kResources, false);
  wrap<&Table::clReleaseContext>(t, "clReleaseContext", kResources, false);
  wrap<&Table::clRetainCommandQueue>(t, "clRetainCommandQueue", kResources, false);
  wrap<&Table::clReleaseCommandQueue>(t, "clReleaseCommandQueue", kResources, false);
  wrap<&Table::clRetainMemObject>(t, "clRetainMemObject", kResources, false);
  wrap<&Table::clReleaseMemObject>(t, "clReleaseMemObject", kResources, false);
  wrap<&Table::clRetainProgram>(t, "clRetainProgram", kResources, false);
  wrap<&Table::clReleaseProgram>(t, "clReleaseProgram", kResources, false);
  wrap<&Table::clRetainKernel>(t, "clRetainKernel", kResources, false);
  wrap<&Table::clReleaseKernel>(t, "clReleaseKernel", kResources, false);
  wrap<&Table::clRetainEvent>(t, "clRetainEvent", kResources, false);
  wrap<&Table::clReleaseEvent>(t, "clReleaseEvent", kResources, false);
}

void check_names(const std::vector<CallAt>& calls) {
  for (const CallAt& call : calls) {
    bool known = false;
    for (const Function* function : functions) known = known || call.function == function->name;
    if (!known) refuse("\"" + call.function + "\" is no function that can fail; see tests/layer/faults.cpp");
  }
}

const pid_t loaded_by = getpid();

void write_counts() {
  if (getpid() != loaded_by) return;  // a fork
  std::FILE* file = std::fopen(settings().count_file.c_str(), "w");
  if (!file) return std::perror(("cloam layer: " + settings().count_file).c_str());
  for (const Function* function : functions)
    if (function->calls) std::fprintf(file, "%s %lld\n", function->name, static_cast<long long>(function->calls));
  std::fclose(file);
}

}  // namespace

cl_icd_dispatch with_faults(const cl_icd_dispatch& driver) {
  below = driver;
  cl_icd_dispatch layer = driver;
  wrap_objects(layer);
  wrap_queries(layer);
  wrap_commands(layer);
  wrap_references(layer);
  check_names(settings().failures);
  check_names(settings().hangs);
  if (!settings().count_file.empty()) std::atexit(write_counts);
  return layer;
}

}  // namespace cloam::layer
