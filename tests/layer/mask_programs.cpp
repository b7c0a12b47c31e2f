// Programs: words of hidden features do not compile, nor do kernels that could not run on the device.
#include <vector>

#include "tests/layer/mask.h"

namespace cloam::layer {
namespace {

/// `pragma GCC poison`, which clang knows, makes a word an error wherever the preprocessor has not thrown it away.
std::string poison(const std::vector<std::string>& words) {
  std::string out = "#pragma GCC poison";
  for (const std::string& word : words) out += " " + word;
  return out + "\n";
}

/// A type with its vectors and the functions that lead to it.
std::vector<std::string> words_of(const std::string& type) {
  std::vector<std::string> out;
  for (const char* width : {"", "2", "3", "4", "8", "16"})
    for (const char* before : {"", "convert_", "as_"}) out.push_back(before + type + width);
  return out;
}

/// What goes before every program: as the profile's own compiler would define it.
std::string prologue() {
  const Profile& p = *profile();
  std::string out = poison({"get_sub_group_size", "get_sub_group_local_id", "get_sub_group_id", "sub_group_barrier",
                            "sub_group_broadcast", "sub_group_reduce_add", "intel_sub_group_shuffle"});
  if (!p.fp64) out += "#undef cl_khr_fp64\n" + poison(words_of("double"));
  if (!p.fp16) out += "#undef cl_khr_fp16\n" + poison(words_of("half"));
  if (!p.images)
    out += "#undef __IMAGE_SUPPORT__\n" +
           poison({"image1d_t", "image2d_t", "image3d_t", "image1d_array_t", "image2d_array_t", "image1d_buffer_t",
                   "sampler_t", "read_imagef", "read_imagei", "read_imageui", "write_imagef"});
  if (!p.atomics64)
    out += "#undef cl_khr_int64_base_atomics\n#undef cl_khr_int64_extended_atomics\n" +
           poison({"atom_add", "atom_sub", "atom_xchg", "atom_inc", "atom_dec", "atom_cmpxchg", "atom_min", "atom_max",
                   "atom_and", "atom_or", "atom_xor"});
  return out + "#line 1\n";
}

cl_program CL_API_CALL create_program(cl_context context, cl_uint count, const char** texts, const size_t* lengths,
                                      cl_int* error) {
  const std::string before = prologue();
  std::vector<const char*> all = {before.c_str()};
  std::vector<size_t> sizes = {before.size()};
  for (cl_uint i = 0; texts && i < count; i++) {
    all.push_back(texts[i]);
    sizes.push_back(lengths ? lengths[i] : 0);
  }
  return driver().clCreateProgramWithSource(context, static_cast<cl_uint>(all.size()), all.data(), sizes.data(), error);
}

/// Local memory and groups that kernels ask for, which real compilers refuse (ptxas, say), whether or not they are
/// used.
cl_int too_large(cl_program program, cl_device_id device) {
  cl_uint count = 0;
  driver().clCreateKernelsInProgram(program, 0, nullptr, &count);
  std::vector<cl_kernel> kernels(count);
  if (count) driver().clCreateKernelsInProgram(program, count, kernels.data(), nullptr);
  cl_int code = CL_SUCCESS;
  for (const cl_kernel kernel : kernels) {
    char name[200] = "";
    size_t group[3] = {};
    cl_ulong local = 0;
    driver().clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name - 1, name, nullptr);
    driver().clGetKernelWorkGroupInfo(kernel, device, CL_KERNEL_COMPILE_WORK_GROUP_SIZE, sizeof group, group, nullptr);
    driver().clGetKernelWorkGroupInfo(kernel, device, CL_KERNEL_LOCAL_MEM_SIZE, sizeof local, &local, nullptr);
    if (group[0] * group[1] * group[2] > largest_group(device))
      code = refused(CL_BUILD_PROGRAM_FAILURE,
                     std::string(name) + " demands groups of " + std::to_string(group[0] * group[1] * group[2]));
    if (local > local_bytes(device))
      code = refused(CL_BUILD_PROGRAM_FAILURE,
                     std::string(name) + " holds " + std::to_string(local) + " bytes of local memory");
    driver().clReleaseKernel(kernel);
  }
  return code;
}

cl_device_id device_of_program(cl_program program) {
  cl_context context = nullptr;
  driver().clGetProgramInfo(program, CL_PROGRAM_CONTEXT, sizeof context, &context, nullptr);
  return device_of(context);
}

cl_int CL_API_CALL build_program(cl_program program, cl_uint count, const cl_device_id* devices, const char* options,
                                 void(CL_CALLBACK* notify)(cl_program, void*), void* user) {
  std::string all = options ? options : "";
  if (!profile()->fp64) all += " -cl-single-precision-constant";  // as 1.0 is read where there is no double
  const cl_int code = driver().clBuildProgram(program, count, devices, all.c_str(), notify, user);
  return code ? code : too_large(program, count ? devices[0] : device_of_program(program));
}

}  // namespace

void mask_programs(cl_icd_dispatch& layer) {
  layer.clCreateProgramWithSource = create_program;
  layer.clBuildProgram = build_program;
}

}  // namespace cloam::layer
