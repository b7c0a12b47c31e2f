// CLBlast as a peer, on the OpenCL device that ours runs on ($CLOAM_PEER_DEVICE, "platform:device").
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <clblast_c.h>

#include <cstdlib>
#include <stdexcept>

#include "benchmarks/peers/product.h"

namespace {

void check(int status, const char* what) {
  if (status != 0) throw std::runtime_error(std::string(what) + " failed: " + std::to_string(status));
}

struct Queue {
  cl_context context = nullptr;
  cl_command_queue queue = nullptr;
  Queue() {
    const char* place = std::getenv("CLOAM_PEER_DEVICE");
    const auto numbers = peer::fields(place ? place : "0:0", ':');
    cl_platform_id platforms[16];
    cl_device_id devices[16];
    check(clGetPlatformIDs(16, platforms, nullptr), "clGetPlatformIDs");
    check(clGetDeviceIDs(platforms[std::stoul(numbers[0])], CL_DEVICE_TYPE_ALL, 16, devices, nullptr),
          "clGetDeviceIDs");
    const cl_device_id device = devices[std::stoul(numbers[1])];
    cl_int status = 0;
    context = clCreateContext(nullptr, 1, &device, nullptr, nullptr, &status);
    check(status, "clCreateContext");
    queue = clCreateCommandQueue(context, device, 0, &status);
    check(status, "clCreateCommandQueue");
  }
};

/// Released with its last handle: the works before would fill the device otherwise.
std::shared_ptr<_cl_mem> buffer(const Queue& q, std::size_t count) {
  std::vector<float> values = peer::random_values(count, 1);
  cl_int status = 0;
  const cl_mem memory =
      clCreateBuffer(q.context, CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR, 4 * count, values.data(), &status);
  check(status, "clCreateBuffer");
  return {memory, clReleaseMemObject};
}

peer::Run prepare(const peer::Product& p) {
  static Queue q;
  const auto count = [](int rows, int columns) { return static_cast<std::size_t>(rows) * columns; };
  const auto a = buffer(q, count(p.m, p.k)), b = buffer(q, count(p.k, p.n)), c = buffer(q, count(p.m, p.n));
  return [=] {
    const auto turned = [](bool yes) { return yes ? CLBlastTransposeYes : CLBlastTransposeNo; };
    check(
        CLBlastSgemm(CLBlastLayoutRowMajor, turned(p.a_turned), turned(p.b_turned), p.m, p.n, p.k, 1, a.get(), 0,
                     p.a_turned ? p.m : p.k, b.get(), 0, p.b_turned ? p.k : p.n, 0, c.get(), 0, p.n, &q.queue, nullptr),
        "CLBlastSgemm");
    check(clFinish(q.queue), "clFinish");
  };
}

}  // namespace

int main() {
  peer::Works all;
  for (const std::string& name : peer::product_names())
    all.push_back({name, [=] { return prepare(peer::product_of(name)); }});
  return peer::serve("CLBlast", std::move(all));
}
