// Buffers: none above the largest allocation, all that live within the global memory, sub-buffers aligned.
#include <map>
#include <mutex>

#include "tests/layer/mask.h"

namespace cloam::layer {
namespace {

struct Object {
  size_t bytes = 0;  // of its own; 0 for a part of another
  int references = 1;
  cl_mem whole = nullptr;  // lives as long as its parts
};

// Never destroyed: a program releases what it holds after its libraries' own statics are gone.
auto& objects = *new std::map<cl_mem, Object>;
auto& lock = *new std::mutex;
size_t live_bytes = 0;

void release(cl_mem memory) {
  const auto at = objects.find(memory);
  if (at == objects.end() || --at->second.references > 0) return;
  const Object gone = at->second;
  objects.erase(at);
  live_bytes -= gone.bytes;
  if (gone.whole) release(gone.whole);
}

cl_int refusal(cl_device_id device, size_t bytes) {
  const std::string what = "a buffer of " + std::to_string(bytes) + " bytes: ";
  const cl_ulong most = largest_bytes(device), all = global_bytes(device);
  if (bytes > most) return refused(CL_INVALID_BUFFER_SIZE, what + "the largest may have " + std::to_string(most));
  if (live_bytes + bytes > all)
    return refused(CL_MEM_OBJECT_ALLOCATION_FAILURE,
                   what + std::to_string(live_bytes) + " of " + std::to_string(all) + " bytes are taken");
  return CL_SUCCESS;
}

cl_mem CL_API_CALL create_buffer(cl_context context, cl_mem_flags flags, size_t bytes, void* host, cl_int* error) {
  const std::lock_guard guard(lock);
  if (const cl_int code = refusal(device_of(context), bytes)) {
    if (error) *error = code;
    return nullptr;
  }
  const cl_mem memory = driver().clCreateBuffer(context, flags, bytes, host, error);
  if (!memory) return memory;
  objects[memory] = {.bytes = bytes};
  live_bytes += bytes;
  return memory;
}

cl_mem CL_API_CALL create_sub_buffer(cl_mem whole, cl_mem_flags flags, cl_buffer_create_type type, const void* info,
                                     cl_int* error) {
  const auto* region = static_cast<const cl_buffer_region*>(info);
  if (region && region->origin % (profile()->align_bits / 8)) {
    if (error)
      *error = refused(CL_MISALIGNED_SUB_BUFFER_OFFSET, "a sub-buffer at byte " + std::to_string(region->origin));
    return nullptr;
  }
  const cl_mem part = driver().clCreateSubBuffer(whole, flags, type, info, error);
  const std::lock_guard guard(lock);
  if (!part) return part;
  objects[part] = {.whole = whole};
  objects[whole].references++;
  return part;
}

cl_int CL_API_CALL retain(cl_mem memory) {
  const cl_int code = driver().clRetainMemObject(memory);
  const std::lock_guard guard(lock);
  const auto at = objects.find(memory);
  if (code == CL_SUCCESS && at != objects.end()) at->second.references++;
  return code;
}

cl_int CL_API_CALL release_object(cl_mem memory) {
  {
    const std::lock_guard guard(lock);
    release(memory);  // first: the driver may give the same address to the next buffer
  }
  return driver().clReleaseMemObject(memory);
}

cl_mem no_image(cl_int* error) {
  if (error) *error = refused(CL_INVALID_OPERATION, "an image");
  return nullptr;
}
cl_mem CL_API_CALL create_image(cl_context, cl_mem_flags, const cl_image_format*, const cl_image_desc*, void*,
                                cl_int* error) {
  return no_image(error);
}
cl_mem CL_API_CALL create_image_2d(cl_context, cl_mem_flags, const cl_image_format*, size_t, size_t, size_t, void*,
                                   cl_int* error) {
  return no_image(error);
}
cl_mem CL_API_CALL create_image_3d(cl_context, cl_mem_flags, const cl_image_format*, size_t, size_t, size_t, size_t,
                                   size_t, void*, cl_int* error) {
  return no_image(error);
}
cl_int CL_API_CALL no_formats(cl_context, cl_mem_flags, cl_mem_object_type, cl_uint, cl_image_format*, cl_uint* count) {
  if (count) *count = 0;
  return CL_SUCCESS;
}

}  // namespace

void mask_memory(cl_icd_dispatch& layer) {
  layer.clCreateBuffer = create_buffer;
  layer.clCreateSubBuffer = create_sub_buffer;
  layer.clRetainMemObject = retain;
  layer.clReleaseMemObject = release_object;
  if (profile()->images) return;
  layer.clCreateImage = create_image;
  layer.clCreateImage2D = create_image_2d;
  layer.clCreateImage3D = create_image_3d;
  layer.clGetSupportedImageFormats = no_formats;
}

}  // namespace cloam::layer
