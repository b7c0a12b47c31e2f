// Kernels: groups, local memory and arguments within the profile's limits.
#include <algorithm>
#include <map>
#include <mutex>

#include "tests/layer/mask.h"

namespace cloam::layer {
namespace {

// Never destroyed, as in mask_memory.cpp. Bytes of each argument that was set last.
auto& arguments = *new std::map<cl_kernel, std::map<cl_uint, size_t>>;
auto& lock = *new std::mutex;

cl_int CL_API_CALL get_work_group_info(cl_kernel kernel, cl_device_id device, cl_kernel_work_group_info name,
                                       size_t bytes, void* to, size_t* ret) {
  if (name == CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE) return answer(profile()->width, {bytes, to, ret});
  const cl_int code = driver().clGetKernelWorkGroupInfo(kernel, device, name, bytes, to, ret);
  if (name == CL_KERNEL_WORK_GROUP_SIZE && code == CL_SUCCESS && to) {
    size_t& group = *static_cast<size_t*>(to);
    group = std::min(group, profile()->group);
  }
  return code;
}

/// Together, without the gaps that alignment may add; memory objects count 8 bytes, local memory none.
cl_int CL_API_CALL set_argument(cl_kernel kernel, cl_uint index, size_t bytes, const void* value) {
  size_t all = 0;
  {
    const std::lock_guard guard(lock);
    std::map<cl_uint, size_t>& of = arguments[kernel];
    of[index] = value ? bytes : 0;
    for (const auto& [at, size] : of) all += size;
  }
  if (all > profile()->argument_bytes)
    return refused(CL_OUT_OF_RESOURCES, "arguments of " + std::to_string(all) + " bytes");
  return driver().clSetKernelArg(kernel, index, bytes, value);
}

cl_kernel CL_API_CALL create_kernel(cl_program program, const char* name, cl_int* error) {
  const cl_kernel kernel = driver().clCreateKernel(program, name, error);
  const std::lock_guard guard(lock);
  arguments.erase(kernel);  // of an earlier kernel at the same address
  return kernel;
}

cl_int refusal(cl_kernel kernel, cl_device_id device, cl_uint axes, const size_t* group) {
  size_t items = 1;
  for (cl_uint axis = 0; group && axis < axes; axis++) {
    if (group[axis] > profile()->items)
      return refused(CL_INVALID_WORK_ITEM_SIZE, "a group with an axis of " + std::to_string(group[axis]));
    items *= group[axis];
  }
  if (items > largest_group(device)) return refused(CL_INVALID_WORK_GROUP_SIZE, "a group of " + std::to_string(items));
  cl_ulong local = 0;
  driver().clGetKernelWorkGroupInfo(kernel, device, CL_KERNEL_LOCAL_MEM_SIZE, sizeof local, &local, nullptr);
  if (local > local_bytes(device))
    return refused(CL_OUT_OF_RESOURCES, "a launch with " + std::to_string(local) + " bytes of local memory");
  return CL_SUCCESS;
}

cl_int CL_API_CALL enqueue(cl_command_queue queue, cl_kernel kernel, cl_uint axes, const size_t* offset,
                           const size_t* global, const size_t* group, cl_uint count, const cl_event* wait,
                           cl_event* event) {
  cl_device_id device = nullptr;
  driver().clGetCommandQueueInfo(queue, CL_QUEUE_DEVICE, sizeof device, &device, nullptr);
  if (const cl_int code = refusal(kernel, device, axes, group)) return code;
  return driver().clEnqueueNDRangeKernel(queue, kernel, axes, offset, global, group, count, wait, event);
}

}  // namespace

void mask_launches(cl_icd_dispatch& layer) {
  layer.clGetKernelWorkGroupInfo = get_work_group_info;
  layer.clSetKernelArg = set_argument;
  layer.clCreateKernel = create_kernel;
  layer.clEnqueueNDRangeKernel = enqueue;
}

}  // namespace cloam::layer
