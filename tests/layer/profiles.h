// Devices whose limits and features a mask shows in the place of the driver's own.
#pragma once
#include <CL/cl.h>

#include <string>

namespace cloam::layer {

struct Profile {
  const char* name;                                                   // profile=NAME
  const char* model;                                                  // the device that it follows
  size_t group;                                                       // work-items in a group, at most
  size_t items;                                                       // and along one axis of it
  size_t width;                                                       // of a sub-group: a kernel's preferred multiple
  cl_ulong local_bytes, global_bytes, largest_bytes, constant_bytes;  // largest: of one allocation
  size_t argument_bytes;                                              // of one kernel, together
  cl_uint align_bits;                                                 // of a sub-buffer's origin
  bool fp64, fp16, images, atomics64;
};

/// The profile of settings(), or null. A name that is none ends the process.
const Profile* profile();

}  // namespace cloam::layer
