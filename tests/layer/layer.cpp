// The two functions by which an OpenCL loader takes a layer in: OPENCL_LAYERS=.../libcloam-layer.so puts it between a
// program and every driver. Faults lie above masks, so that a masked device can fail, too.
#include <CL/cl_layer.h>

#include <algorithm>
#include <cstring>

#include "tests/layer/faults.h"
#include "tests/layer/mask.h"

namespace {

constexpr char kName[] = "cloam-layer";

}  // namespace

extern "C" {

[[gnu::visibility("default")]] cl_int CL_API_CALL clGetLayerInfo(cl_layer_info name, size_t room, void* to,
                                                                 size_t* bytes_ret) {
  const cl_layer_api_version version = CL_LAYER_API_VERSION_100;
  if (name == CL_LAYER_API_VERSION) return cloam::layer::answer(version, {room, to, bytes_ret});
  if (name == CL_LAYER_NAME) return cloam::layer::answer(kName, {room, to, bytes_ret});
  return CL_INVALID_VALUE;
}

[[gnu::visibility("default")]] cl_int CL_API_CALL clInitLayer(cl_uint entries, const cl_icd_dispatch* target,
                                                              cl_uint* entries_ret, const cl_icd_dispatch** layer_ret) {
  if (!target || !entries_ret || !layer_ret) return CL_INVALID_VALUE;
  constexpr cl_uint kEntries = sizeof(cl_icd_dispatch) / sizeof(void*);
  static cl_icd_dispatch driver{};
  std::memcpy(&driver, target, std::min(entries, kEntries) * sizeof(void*));
  static const cl_icd_dispatch layer = cloam::layer::with_faults(cloam::layer::with_mask(driver));
  *entries_ret = std::min(entries, kEntries);
  *layer_ret = &layer;
  return CL_SUCCESS;
}

}  // extern "C"
