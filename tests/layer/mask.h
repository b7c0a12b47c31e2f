// A mask: a driver's device with the limits and features of a profile, which are not only told but held to. Shared by
// the parts of the mask, one a group of functions.
#pragma once
#include <CL/cl_icd.h>

#include <string>

#include "tests/layer/profiles.h"

namespace cloam::layer {

/// `driver` masked as profile() says, or as it is.
cl_icd_dispatch with_mask(const cl_icd_dispatch& driver);

/// What the mask calls. Set before anything else here is used.
const cl_icd_dispatch& driver();

void mask_device(cl_icd_dispatch& layer);
void mask_memory(cl_icd_dispatch& layer);
void mask_programs(cl_icd_dispatch& layer);
void mask_launches(cl_icd_dispatch& layer);

/// The smaller of the profile's number and the driver's: a mask never shows more than there is.
cl_ulong least_of(cl_device_id device, cl_device_info name, cl_ulong of_profile);
inline cl_ulong global_bytes(cl_device_id device) {
  return least_of(device, CL_DEVICE_GLOBAL_MEM_SIZE, profile()->global_bytes);
}
inline cl_ulong largest_bytes(cl_device_id device) {
  return least_of(device, CL_DEVICE_MAX_MEM_ALLOC_SIZE, profile()->largest_bytes);
}
inline cl_ulong local_bytes(cl_device_id device) {
  return least_of(device, CL_DEVICE_LOCAL_MEM_SIZE, profile()->local_bytes);
}
size_t largest_group(cl_device_id device);

cl_device_id device_of(cl_context context);  // the first one

/// The place that a query gives for its answer.
struct Room {
  size_t bytes;
  void* to;
  size_t* bytes_ret;
};
/// Answers a query as OpenCL's do: CL_INVALID_VALUE if the room is too small.
cl_int answer_bytes(const void* value, size_t bytes, const Room& room);
template <class T>
cl_int answer(const T& value, const Room& room) {
  return answer_bytes(&value, sizeof value, room);
}
inline cl_int answer_text(const std::string& value, const Room& room) {
  return answer_bytes(value.c_str(), value.size() + 1, room);
}

/// Says on stderr what the mask refused, and gives the code back.
cl_int refused(cl_int code, const std::string& why);

}  // namespace cloam::layer
