// The layer of tests/layer, through OpenCL itself: each child runs under it and tries what it is to refuse.
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <doctest/doctest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include "tests/runtime/child.h"

using namespace cloam;

namespace {

/// The first device of the first platform that has one.
struct OpenDevice {
  cl_device_id device = nullptr;
  cl_context context = nullptr;
  cl_command_queue queue = nullptr;
  OpenDevice() {
    cl_platform_id platforms[8] = {};
    cl_uint count = 0;
    clGetPlatformIDs(8, platforms, &count);
    for (cl_uint i = 0; i < count && i < 8 && !device; i++)
      clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_GPU, 1, &device, nullptr);
    for (cl_uint i = 0; i < count && i < 8 && !device; i++)
      clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_ALL, 1, &device, nullptr);
    context = clCreateContext(nullptr, 1, &device, nullptr, nullptr, nullptr);
    queue = clCreateCommandQueue(context, device, 0, nullptr);
  }
  template <class T>
  T info(cl_device_info name) const {
    T value{};
    clGetDeviceInfo(device, name, sizeof value, &value, nullptr);
    return value;
  }
  std::string words(cl_device_info name) const {
    char text[4096] = "";
    clGetDeviceInfo(device, name, sizeof text, text, nullptr);
    return text;
  }
  /// The error of creating a buffer, which is kept if there is none.
  cl_int create(size_t bytes) {
    cl_int error = CL_SUCCESS;
    const cl_mem made = clCreateBuffer(context, CL_MEM_READ_WRITE, bytes, nullptr, &error);
    if (made) buffers.push_back(made);
    return error;
  }
  cl_int build(const char* text, cl_kernel* kernel = nullptr) const {
    const cl_program program = clCreateProgramWithSource(context, 1, &text, nullptr, nullptr);
    const cl_int code = clBuildProgram(program, 1, &device, "-cl-std=CL1.2 -w", nullptr, nullptr);
    if (kernel) *kernel = clCreateKernel(program, "f", nullptr);
    return code;
  }
  cl_int launch(cl_kernel kernel, size_t items) const {
    return clEnqueueNDRangeKernel(queue, kernel, 1, nullptr, &items, &items, 0, nullptr, nullptr);
  }
  std::vector<cl_mem> buffers;
};

std::string under_layer(const std::string& settings, const std::string& test_case) {
  return output_of_child("OPENCL_LAYERS=" CLOAM_LAYER_LIBRARY " CLOAM_LAYER=" + settings, test_case);
}
bool passed(const std::string& output) {
  return std::regex_search(output, std::regex(R"(test cases: +1 \| +1 passed)"));
}

constexpr size_t kMiB = 1 << 20;

}  // namespace

TEST_CASE("child: limits of the least device" * doctest::skip()) {
  OpenDevice on;
  cl_uint count = 0;
  cl_platform_id platform = on.info<cl_platform_id>(CL_DEVICE_PLATFORM);
  CHECK(clGetDeviceIDs(platform, CL_DEVICE_TYPE_CPU, 0, nullptr, &count) == CL_DEVICE_NOT_FOUND);
  CHECK(clGetDeviceIDs(platform, CL_DEVICE_TYPE_GPU, 0, nullptr, &count) == CL_SUCCESS);
  CHECK(on.info<cl_device_type>(CL_DEVICE_TYPE) == CL_DEVICE_TYPE_GPU);
  CHECK(on.info<size_t>(CL_DEVICE_MAX_WORK_GROUP_SIZE) == 64);
  CHECK(on.info<cl_ulong>(CL_DEVICE_LOCAL_MEM_SIZE) == 32 << 10);
  CHECK(on.info<cl_ulong>(CL_DEVICE_MAX_MEM_ALLOC_SIZE) == 64 * kMiB);
  CHECK(on.info<cl_device_fp_config>(CL_DEVICE_DOUBLE_FP_CONFIG) == 0);
  CHECK(on.words(CL_DEVICE_VERSION).starts_with("OpenCL 1.2 "));
  CHECK(on.words(CL_DEVICE_EXTENSIONS).find("cl_khr_fp64") == std::string::npos);
}

TEST_CASE("child: memory of the least device" * doctest::skip()) {
  OpenDevice on;
  CHECK(on.create(64 * kMiB + 1) == CL_INVALID_BUFFER_SIZE);
  for (int i = 0; i < 8; i++) CHECK(on.create(64 * kMiB) == CL_SUCCESS);
  CHECK(on.create(1) == CL_MEM_OBJECT_ALLOCATION_FAILURE);
  cl_int code = CL_SUCCESS;
  cl_buffer_region region{256, 1024};
  const cl_mem whole = on.buffers.back();
  const cl_mem part = clCreateSubBuffer(whole, CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &region, &code);
  CHECK(code == CL_SUCCESS);
  region.origin = 64;
  CHECK(clCreateSubBuffer(whole, CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &region, &code) == nullptr);
  CHECK(code == CL_MISALIGNED_SUB_BUFFER_OFFSET);
  clRetainMemObject(whole);
  clReleaseMemObject(whole);
  clReleaseMemObject(whole);
  CHECK(on.create(1) == CL_MEM_OBJECT_ALLOCATION_FAILURE);  // its part holds it
  clReleaseMemObject(part);
  CHECK(on.create(64 * kMiB) == CL_SUCCESS);
  const cl_image_format format{CL_RGBA, CL_FLOAT};
  cl_image_desc image{};
  image.image_type = CL_MEM_OBJECT_IMAGE2D;
  image.image_width = image.image_height = 4;
  CHECK(clCreateImage(on.context, CL_MEM_READ_ONLY, &format, &image, nullptr, &code) == nullptr);
  CHECK(code == CL_INVALID_OPERATION);
}

TEST_CASE("child: programs of the least device" * doctest::skip()) {
  OpenDevice on;
  CHECK(on.build("__kernel void f(__global float* x) { x[0] = 2.0f * x[1]; }") == CL_SUCCESS);
  CHECK(on.build("__kernel void f(__global float* x) { x[0] = (float)((double)x[1]); }") == CL_BUILD_PROGRAM_FAILURE);
  CHECK(on.build("__kernel void f(__global float* x) { half h = x[1]; x[0] = h * h; }") == CL_BUILD_PROGRAM_FAILURE);
  CHECK(on.build("__kernel void f(__global half* x) { vstore_half(2.0f * vload_half(1, x), 0, x); }") == CL_SUCCESS);
  CHECK(on.build("__kernel void f(__global float* x) { x[0] = convert_half2((float2)(x[1])).x; }") ==
        CL_BUILD_PROGRAM_FAILURE);
  CHECK(on.build("__kernel void f(__read_only image2d_t x) {}") == CL_BUILD_PROGRAM_FAILURE);
  CHECK(on.build("#ifdef cl_khr_fp64\n#error shown\n#endif\n__kernel void f(__global int* x) {}") == CL_SUCCESS);
  CHECK(on.build("__kernel __attribute__((reqd_work_group_size(65, 1, 1))) void f(__global int* x) {}") ==
        CL_BUILD_PROGRAM_FAILURE);
  CHECK(on.build("__kernel void f(__global int* x) { __local int y[8193]; y[get_local_id(0)] = x[0];\n"
                 "barrier(CLK_LOCAL_MEM_FENCE); x[1] = y[x[2]]; }") == CL_BUILD_PROGRAM_FAILURE);
  cl_kernel exact = nullptr;  // 0.1 as a double and as a float differ
  CHECK(on.build("__kernel void f(__global float* x) { x[0] = (float)((0.1 - 0.1f) * 1e9); }", &exact) == CL_SUCCESS);
  on.create(4);
  float apart = 1;
  clSetKernelArg(exact, 0, sizeof(cl_mem), &on.buffers.back());
  CHECK(on.launch(exact, 1) == CL_SUCCESS);
  clEnqueueReadBuffer(on.queue, on.buffers.back(), CL_TRUE, 0, 4, &apart, 0, nullptr, nullptr);
  CHECK(apart == 0);
}

TEST_CASE("child: launches of the least device" * doctest::skip()) {
  OpenDevice on;
  on.create(1024);
  cl_kernel kernel = nullptr;
  CHECK(on.build("typedef struct { int at[252]; } Many; __kernel void f(__global int* x, __local int* y, Many m) {\n"
                 "y[get_local_id(0)] = m.at[get_local_id(0)]; barrier(CLK_LOCAL_MEM_FENCE); x[0] = y[0]; }",
                 &kernel) == CL_SUCCESS);
  const std::vector<int> many(256);
  CHECK(clSetKernelArg(kernel, 0, sizeof(cl_mem), &on.buffers[0]) == CL_SUCCESS);
  CHECK(clSetKernelArg(kernel, 1, 1024, nullptr) == CL_SUCCESS);
  CHECK(clSetKernelArg(kernel, 2, 1020, many.data()) == CL_OUT_OF_RESOURCES);
  CHECK(clSetKernelArg(kernel, 2, 1008, many.data()) == CL_SUCCESS);
  CHECK(on.launch(kernel, 65) == CL_INVALID_WORK_ITEM_SIZE);
  const size_t square[] = {16, 16};
  CHECK(clEnqueueNDRangeKernel(on.queue, kernel, 2, nullptr, square, square, 0, nullptr, nullptr) ==
        CL_INVALID_WORK_GROUP_SIZE);
  CHECK(on.launch(kernel, 64) == CL_SUCCESS);
  CHECK(clSetKernelArg(kernel, 1, (32 << 10) + 4, nullptr) == CL_SUCCESS);
  CHECK(on.launch(kernel, 64) == CL_OUT_OF_RESOURCES);
  clFinish(on.queue);
}

TEST_CASE("a masked device tells its limits, and is held to them") {
  for (const char* what : {"limits", "memory", "programs", "launches"}) {
    const std::string said = under_layer("profile=least", std::string("child: ") + what + " of the least device");
    CHECK_MESSAGE(passed(said), said);
  }
}

TEST_CASE("child: four buffers" * doctest::skip()) {
  OpenDevice on;
  for (int i = 0; i < 4; i++) std::printf("buffer %d ", on.create(64));
  std::printf("finish %d\n", clFinish(on.queue));
}

TEST_CASE("the layer makes the n-th call fail, once, from then on, or all of a device that is lost") {
  const auto prints = [](const std::string& settings, const std::string& line) {
    const std::string said = under_layer(settings, "child: four buffers");
    CHECK_MESSAGE(said.find(line) != std::string::npos, settings << " printed\n" << said);
  };
  prints("fail=clCreateBuffer:2", "buffer 0 buffer -4 buffer 0 buffer 0 finish 0\n");
  prints("fail=clCreateBuffer:2+", "buffer 0 buffer -4 buffer -4 buffer -4 finish 0\n");
  prints("fail=clCreateBuffer:2:-6,fail=clCreateBuffer:4", "buffer 0 buffer -6 buffer 0 buffer -4 finish 0\n");
  prints("fail=clCreateBuffer:3,sticky", "buffer 0 buffer 0 buffer -4 buffer -5 finish -5\n");
  prints("fail=clFinish:1", "buffer 0 buffer 0 buffer 0 buffer 0 finish -5\n");
  prints("fail=clCreateBuffer:1/2", "buffer -4 buffer 0 buffer -4 buffer 0 finish 0\n");
  prints("profile=least,fail=clCreateBuffer:1", "buffer -4 buffer 0 buffer 0 buffer 0 finish 0\n");
}

TEST_CASE("the layer counts calls, hangs, and refuses words that it does not know") {
  const std::string file = std::filesystem::temp_directory_path() / ("cloam-calls-" + std::to_string(getpid()));
  under_layer("count=" + file, "child: four buffers");
  std::string name, counted;
  long calls = 0;
  for (std::ifstream counts(file); counts >> name >> calls;) counted += name + " " + std::to_string(calls) + "\n";
  std::filesystem::remove(file);
  CHECK(counted.find("clCreateBuffer 4\n") != std::string::npos);
  CHECK(counted.find("clFinish 1\n") != std::string::npos);
  CHECK(counted.find("clEnqueueNDRangeKernel") == std::string::npos);
  const std::string hung = output_of_child(
      "timeout 2 env OPENCL_LAYERS=" CLOAM_LAYER_LIBRARY " CLOAM_LAYER=hang=clCreateBuffer:1", "child: four buffers");
  CHECK_MESSAGE(hung.find("buffer 0") == std::string::npos, hung);
  for (const char* wrong : {"fail=clNothing:1", "fail=clFinish", "fail=clFinish:0", "profile=none", "sticki"}) {
    const std::string said = under_layer(wrong, "child: four buffers");
    CHECK_MESSAGE(said.find("cloam layer: CLOAM_LAYER: ") != std::string::npos, said);
    CHECK_MESSAGE(said.find("finish") == std::string::npos, said);
  }
}
