// Queries of platforms and devices: the masked device is a GPU of OpenCL 1.2 with the profile's limits.
#include <array>
#include <sstream>

#include "tests/layer/mask.h"
#include "tests/layer/settings.h"

namespace cloam::layer {
namespace {

std::string text_of(cl_device_id device, cl_device_info name) {
  size_t bytes = 0;
  driver().clGetDeviceInfo(device, name, 0, nullptr, &bytes);
  std::string out(bytes, '\0');
  driver().clGetDeviceInfo(device, name, bytes, out.data(), nullptr);
  while (!out.empty() && out.back() == '\0') out.pop_back();
  return out;
}

/// Extensions that every GPU has, and those of the profile; none that the driver lacks.
bool shown(const std::string& extension) {
  const Profile& p = *profile();
  if (extension == "cl_khr_fp64") return p.fp64;
  if (extension == "cl_khr_fp16") return p.fp16;
  if (extension == "cl_khr_int64_base_atomics" || extension == "cl_khr_int64_extended_atomics") return p.atomics64;
  if (extension == "cl_khr_3d_image_writes") return p.images;
  return extension == "cl_khr_byte_addressable_store" || extension == "cl_khr_icd" ||
         extension.find("int32_base_atomics") != std::string::npos ||
         extension.find("int32_extended_atomics") != std::string::npos;
}

std::string extensions(cl_device_id device) {
  std::istringstream words(text_of(device, CL_DEVICE_EXTENSIONS));
  std::string out;
  for (std::string word; words >> word;)
    if (shown(word)) out += (out.empty() ? "" : " ") + word;
  return out;
}

cl_int features(cl_device_id device, cl_device_info name, const Room& room) {
  const Profile& p = *profile();
  const bool hidden = ((name == CL_DEVICE_DOUBLE_FP_CONFIG || name == CL_DEVICE_PREFERRED_VECTOR_WIDTH_DOUBLE ||
                        name == CL_DEVICE_NATIVE_VECTOR_WIDTH_DOUBLE) &&
                       !p.fp64) ||
                      ((name == CL_DEVICE_HALF_FP_CONFIG || name == CL_DEVICE_PREFERRED_VECTOR_WIDTH_HALF ||
                        name == CL_DEVICE_NATIVE_VECTOR_WIDTH_HALF) &&
                       !p.fp16) ||
                      (name == CL_DEVICE_IMAGE_SUPPORT && !p.images);
  if (!hidden) return driver().clGetDeviceInfo(device, name, room.bytes, room.to, room.bytes_ret);
  if (name == CL_DEVICE_DOUBLE_FP_CONFIG || name == CL_DEVICE_HALF_FP_CONFIG)
    return answer<cl_device_fp_config>(0, room);
  return answer<cl_uint>(0, room);
}

cl_int limits(cl_device_id device, cl_device_info name, const Room& room) {
  const Profile& p = *profile();
  switch (name) {
    case CL_DEVICE_MAX_WORK_GROUP_SIZE:
      return answer(largest_group(device), room);
    case CL_DEVICE_MAX_WORK_ITEM_SIZES:
      return answer(std::array<size_t, 3>{p.items, p.items, p.items}, room);
    case CL_DEVICE_LOCAL_MEM_SIZE:
      return answer(local_bytes(device), room);
    case CL_DEVICE_GLOBAL_MEM_SIZE:
      return answer(global_bytes(device), room);
    case CL_DEVICE_MAX_MEM_ALLOC_SIZE:
      return answer(largest_bytes(device), room);
    case CL_DEVICE_MAX_CONSTANT_BUFFER_SIZE:
      return answer(least_of(device, name, p.constant_bytes), room);
    case CL_DEVICE_MAX_PARAMETER_SIZE:
      return answer(least_of(device, name, p.argument_bytes), room);
    case CL_DEVICE_MEM_BASE_ADDR_ALIGN:
      return answer(p.align_bits, room);
    default:
      return features(device, name, room);
  }
}

cl_int CL_API_CALL get_device_info(cl_device_id device, cl_device_info name, size_t bytes, void* to, size_t* ret) {
  constexpr cl_device_info kFirstAfter12 = 0x104A, kLastOfKhronos = 0x107F;  // queries that OpenCL 1.2 does not have
  const Room room{bytes, to, ret};
  if (name >= kFirstAfter12 && name <= kLastOfKhronos) return CL_INVALID_VALUE;
  switch (name) {
    case CL_DEVICE_TYPE:
      return answer<cl_device_type>(CL_DEVICE_TYPE_GPU, room);
    case CL_DEVICE_NAME:
      return answer_text(std::string(profile()->name) + " mask of " + text_of(device, CL_DEVICE_NAME), room);
    case CL_DEVICE_VERSION:
      return answer_text("OpenCL " + settings().version + " cloam-layer", room);
    case CL_DEVICE_OPENCL_C_VERSION:
      return answer_text("OpenCL C " + settings().version + " cloam-layer", room);
    case CL_DEVICE_EXTENSIONS:
      return answer_text(extensions(device), room);
    case CL_DEVICE_LOCAL_MEM_TYPE:
      return answer<cl_device_local_mem_type>(CL_LOCAL, room);
    default:
      return limits(device, name, room);
  }
}

cl_int CL_API_CALL get_platform_info(cl_platform_id platform, cl_platform_info name, size_t bytes, void* to,
                                     size_t* ret) {
  if (name == CL_PLATFORM_VERSION)
    return answer_text("OpenCL " + settings().version + " cloam-layer", {bytes, to, ret});
  return driver().clGetPlatformInfo(platform, name, bytes, to, ret);
}

/// All devices of the driver are GPUs.
cl_device_type asked_of_driver(cl_device_type type) {
  return type & (CL_DEVICE_TYPE_GPU | CL_DEVICE_TYPE_DEFAULT) ? CL_DEVICE_TYPE_ALL : 0;
}

cl_int CL_API_CALL get_device_ids(cl_platform_id platform, cl_device_type type, cl_uint room, cl_device_id* to,
                                  cl_uint* count) {
  if (!asked_of_driver(type)) return CL_DEVICE_NOT_FOUND;
  return driver().clGetDeviceIDs(platform, asked_of_driver(type), room, to, count);
}

cl_context CL_API_CALL create_context_from_type(const cl_context_properties* properties, cl_device_type type,
                                                void(CL_CALLBACK* notify)(const char*, const void*, size_t, void*),
                                                void* user, cl_int* error) {
  if (asked_of_driver(type))
    return driver().clCreateContextFromType(properties, asked_of_driver(type), notify, user, error);
  if (error) *error = CL_DEVICE_NOT_FOUND;
  return nullptr;
}

}  // namespace

void mask_device(cl_icd_dispatch& layer) {
  layer.clGetPlatformInfo = get_platform_info;
  layer.clGetDeviceIDs = get_device_ids;
  layer.clGetDeviceInfo = get_device_info;
  layer.clCreateContextFromType = create_context_from_type;
}

}  // namespace cloam::layer
