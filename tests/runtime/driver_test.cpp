// What the runtime makes of a driver that fails: tests/layer lets single calls fail, in a child process.
#include <doctest/doctest.h>

#include <cstdio>
#include <cstdlib>
#include <functional>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/ops.h"
#include "runtime/profile.h"
#include "tests/runtime/child.h"

using namespace cloam;

namespace {

/// Does it, and once more after a fault.
void attempt(const std::function<void()>& work) {
  for (int i = 0; i < 2; i++) try {
      return work();
    } catch (const Error& error) { std::printf("fault %d: %s\n", static_cast<int>(error.fault()), error.what()); }
}

std::string with_faults(const std::string& faults, const std::string& child, const std::string& more = "") {
  return output_of_child("OPENCL_LAYERS=" CLOAM_LAYER_LIBRARY " CLOAM_LAYER=" + faults + " " + more, child);
}

bool has(const std::string& where, const std::string& what) { return where.find(what) != std::string::npos; }

constexpr char kGraph[] = "child: a graph that is asked for twice";
/// 64 ones times 64 ones, halved, plus 1: 33; 64 of them, 4,096 times.
constexpr char kRight[] = "value 8650752, live 0\n";

}  // namespace

TEST_CASE("child: a graph that is asked for twice" * doctest::skip()) {
  Tensor ones, result, large;
  attempt([&] { ones = from_host(std::vector<float>(4096, 1.f), {64, 64}); });
  if (!ones) return;
  if (std::getenv("CLOAM_TEST_PROFILE")) attempt([] { start_profile(); });
  result = sum(matmul(matmul(ones, ones) * 0.5f + 1.f, ones));
  double value = 0;
  attempt([&] { value = static_cast<double>(result.item()); });
  attempt([&] { large = dense(zeros({int64_t{1} << 20})); });  // large pages: mapped once
  ones = result = large = {};
  std::printf("value %.9g, live %llu\n", value, static_cast<unsigned long long>(device_stats().live_bytes));
}

TEST_CASE("a call that fails for lack of room succeeds when it is made again") {
  for (const char* call : {"clCreateBuffer:1", "clCreateBuffer:3", "clEnqueueWriteBuffer:1", "clEnqueueNDRangeKernel:1",
                           "clEnqueueNDRangeKernel:2", "clSetKernelArg:1", "clSetKernelArg:7", "clCreateKernel:1",
                           "clCreateProgramWithSource:1", "clEnqueueMapBuffer:1", "clEnqueueUnmapMemObject:1",
                           "clBuildProgram:1:-5", "clBuildProgram:1"}) {
    CAPTURE(call);
    const std::string out = with_faults(std::string("fail=") + call, kGraph);
    CHECK_MESSAGE(has(out, kRight), out);
    CHECK_MESSAGE(!has(out, "fault"), out);
  }
}

TEST_CASE("a call that fails again is an error that says what was done, and what was answered by whom") {
  struct Row {
    const char* call;
    int fault;
    const char* says;
  };
  for (const Row& row : {
           Row{"clCreateBuffer:1+", 5,
               "cannot make a buffer of 16384 bytes: clCreateBuffer gave "
               "CL_MEM_OBJECT_ALLOCATION_FAILURE (-4) on "},
           Row{"clEnqueueWriteBuffer:1+", 5,
               "cannot write 16384 bytes into a buffer: clEnqueueWriteBuffer gave "
               "CL_OUT_OF_RESOURCES (-5) on "},
           Row{"clEnqueueNDRangeKernel:1+", 4, "cannot launch the kernel matmul"},
           Row{"clSetKernelArg:1+", 4, "cannot set argument 0 of the kernel "},
           Row{"clCreateKernel:1+", 4, "cannot make the kernel "},
           Row{"clEnqueueReadBuffer:1+", 4,
               "cannot read 4 bytes of a buffer after these launches, the last one first: sum"},
           Row{"clFinish:1+", 4, "cannot make a buffer of "},
           Row{"clBuildProgram:1+", 4, "cannot compile "},
       }) {
    CAPTURE(row.call);
    // A wait is needed for a fault of waiting: the first buffer fails, and room is to be made.
    const std::string more = std::string(row.call).starts_with("clFinish") ? "fail=clCreateBuffer:1," : "";
    const std::string out = with_faults(more + "fail=" + row.call, kGraph);
    CHECK_MESSAGE(has(out, "fault " + std::to_string(row.fault) + ": "), out);
    CHECK_MESSAGE(has(out, row.says), out);
    CHECK_MESSAGE(has(out, "\n  fix: "), out);
  }
}

TEST_CASE("a launch that failed leaves a graph that can be evaluated, wherever it was") {
  int faults = 0;
  for (std::string out; faults < 50; faults++) {
    const std::string first = std::to_string(faults + 1), again = std::to_string(faults + 2);
    out = with_faults("fail=clEnqueueNDRangeKernel:" + first + ",fail=clEnqueueNDRangeKernel:" + again, kGraph);
    CHECK_MESSAGE(has(out, kRight), out);
    if (!has(out, "fault 4: ")) break;
  }
  CHECK(faults >= 3);
  CHECK(faults < 50);
}

TEST_CASE("a kernel that could not be built is built when it is asked for again") {
  for (const char* call : {"clBuildProgram:1,fail=clBuildProgram:2,fail=clBuildProgram:3,fail=clBuildProgram:4",
                           "clBuildProgram:2,fail=clBuildProgram:3,fail=clBuildProgram:4,fail=clBuildProgram:5",
                           "clCreateKernel:1:-46", "clCreateKernel:2:-46", "clCreateKernel:3:-46"}) {
    CAPTURE(call);
    const std::string out = with_faults(std::string("fail=") + call, kGraph);
    CHECK_MESSAGE(has(out, "fault 4: "), out);
    CHECK_MESSAGE(has(out, kRight), out);
  }
}

TEST_CASE("a device that is lost ends in errors, also while launches are timed") {
  for (const char* call :
       {"clEnqueueNDRangeKernel:2", "clEnqueueReadBuffer:1", "clCreateBuffer:2", "clGetEventInfo:2"}) {
    CAPTURE(call);
    const std::string out = with_faults(std::string("sticky,fail=") + call, kGraph, "CLOAM_TEST_PROFILE=1");
    CHECK_MESSAGE(has(out, "fault 4: "), out);
    CHECK_MESSAGE(has(out, "the device no longer answers"), out);
    CHECK_MESSAGE(has(out, "value 0, live 0\n"), out);
  }
}

TEST_CASE("child: much work and one wait" * doctest::skip()) {
  const Tensor by = dense(random_normal({1024, 1024}, {1}));
  Tensor x = by;
  for (int i = 0; i < 100; i++) eval({x = matmul(by, x) / 32.f});
  std::printf("value %g\n", static_cast<double>(sum(x).item()));
}

TEST_CASE("a device that hangs ends the program and is told with what was launched; one that works is waited for") {
  const std::string hung = with_faults("hang=clFinish:1,fail=clCreateBuffer:1", kGraph, "CLOAM_WATCHDOG=0.5");
  CHECK_MESSAGE(has(hung, "error: the device has not answered for 0.5 s: "), hung);
  CHECK_MESSAGE(!has(hung, "value"), hung);
  if (device().is_cpu) {  // nothing is seen of how other devices work
    const std::string slow = output_of_child("CLOAM_WATCHDOG=0.5", "child: much work and one wait");
    CHECK_MESSAGE(has(slow, "value "), slow);
  }
  CHECK_MESSAGE(has(output_of_child("CLOAM_WATCHDOG=soon", kGraph), "fault 2: CLOAM_WATCHDOG=soon: want seconds"), "");
}
