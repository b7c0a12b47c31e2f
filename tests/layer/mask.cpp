// What the parts of a mask share, and putting them together.
#include "tests/layer/mask.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <vector>

namespace cloam::layer {
namespace {

cl_icd_dispatch below;

}  // namespace

const cl_icd_dispatch& driver() { return below; }

cl_icd_dispatch with_mask(const cl_icd_dispatch& unmasked) {
  below = unmasked;
  cl_icd_dispatch layer = unmasked;
  if (!profile()) return layer;
  mask_device(layer);
  mask_memory(layer);
  mask_programs(layer);
  mask_launches(layer);
  return layer;
}

cl_ulong least_of(cl_device_id device, cl_device_info name, cl_ulong of_profile) {
  cl_ulong of_driver = 0;  // size_t and cl_ulong are alike here
  static_assert(sizeof(cl_ulong) == sizeof(size_t));
  below.clGetDeviceInfo(device, name, sizeof of_driver, &of_driver, nullptr);
  return std::min(of_driver, of_profile);
}

size_t largest_group(cl_device_id device) { return least_of(device, CL_DEVICE_MAX_WORK_GROUP_SIZE, profile()->group); }

cl_device_id device_of(cl_context context) {
  cl_uint count = 0;
  below.clGetContextInfo(context, CL_CONTEXT_NUM_DEVICES, sizeof count, &count, nullptr);
  std::vector<cl_device_id> devices(std::max<cl_uint>(1, count));
  below.clGetContextInfo(context, CL_CONTEXT_DEVICES, devices.size() * sizeof(cl_device_id), devices.data(), nullptr);
  return devices.front();
}

cl_int answer_bytes(const void* value, size_t bytes, const Room& room) {
  if (room.to && room.bytes < bytes) return CL_INVALID_VALUE;
  if (room.to) std::memcpy(room.to, value, bytes);
  if (room.bytes_ret) *room.bytes_ret = bytes;
  return CL_SUCCESS;
}

cl_int refused(cl_int code, const std::string& why) {
  std::fprintf(stderr, "cloam layer: %s: %s\n", profile()->name, why.c_str());
  return code;
}

}  // namespace cloam::layer
