// Private to runtime/: the OpenCL objects behind device.h, the buffer pool, the kernel cache, and launch().
#pragma once
#include <CL/opencl.hpp>
#include <array>
#include <concepts>
#include <functional>
#include <span>
#include <utility>

#include "runtime/device.h"
#include "runtime/device_lock.h"
#include "runtime/error.h"
#include "runtime/op.h"
#include "runtime/variant.h"

namespace cloam {

/// A block of device memory on loan from the pool; goes back when the last tensor lets go.
struct Buffer {
  std::shared_ptr<std::byte> given;  // the host's memory that `mem` lies in, where the device did not choose it
  cl::Buffer mem;
  size_t bytes = 0;
  std::shared_ptr<Buffer> whole;  // of a part of a buffer, which is no loan of its own
  bool pooled = true;             // freed, it serves others
  Buffer(cl::Buffer memory, size_t size) : mem(std::move(memory)), bytes(size) {}
  ~Buffer();
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
};

struct ClDevice {
  cl::Platform platform;
  cl::Device device;
  cl::Context context;
  cl::CommandQueue queue;
  DeviceInfo info;
};
ClDevice& cl_device();
/// In a process that was forked from one that had opened the device: cl_device() throws, and nothing is left to end.
bool left_by_fork();

/// From the pool: up to a quarter larger, so that others find it again.
std::shared_ptr<Buffer> allocate(size_t bytes);
/// Of this size, for what stays as long as the model; the driver gets it back.
std::shared_ptr<Buffer> allocate_to_stay(size_t bytes);
/// In memory of the caller's.
std::shared_ptr<Buffer> buffer_in(std::shared_ptr<std::byte> memory, size_t bytes);
void read_buffer(const Buffer& buffer, size_t offset, size_t bytes, void* to);
void write_buffer(const Buffer& buffer, const void* from, size_t bytes);
enum class HostUse { read, change, overwrite };
/// Calls `use` with bytes of a buffer, in place where the device shares the host's memory, else with a copy. What is to
/// be overwritten holds anything at first.
void use_on_host(const Buffer& buffer, size_t offset, size_t bytes, HostUse kind,
                 const std::function<void(std::span<std::byte>)>& use);
/// The first bytes of a buffer that the host sees in place, as long as the pointer lives; nobody may write them
/// meanwhile.
std::shared_ptr<const std::byte> mapped_to_read(const std::shared_ptr<Buffer>& buffer, size_t bytes);
void finish();

/// kernels/<stem>.cl, compiled once per set of constants.
cl::Kernel& kernel(const char* stem, const char* name, const Constants& constants = {});
/// A kernel of a chosen variant's file, with its constants; `more`: those that the op's code decides (transposes, say).
cl::Kernel& kernel(const Variant& variant, const char* name, const Constants& more = {});
/// The one that the variant names.
inline cl::Kernel& kernel(const Variant& variant, const Constants& more = {}) {
  return kernel(variant, variant.kernel.c_str(), more);
}
bool has_kernel_text(const std::string& stem);
std::string kernel_text(const std::string& stem);
std::vector<std::string> kernel_stems();

/// One generated kernel: its name is a hash of its text. Missing ones are compiled together, in one program.
struct Generated {
  std::string name, source;
};
void build_generated(const std::vector<Generated>& kernels);
cl::Kernel& generated_kernel(const Generated& kernel);

struct Range {
  std::array<size_t, 3> global{1, 1, 1};
  std::array<size_t, 3> local{1, 1, 1};
  double flops = 0;  // for the profile line
};
/// Work-items in one dimension, `local` a group, rounded up: the kernel guards the rest.
Range range1(int64_t items, int64_t local = 1);
Range range2(int64_t x, int64_t y);
/// Items walked one after another by fat work-items of `cpu_chunk` each, or one a lane in groups of 64.
struct Chunks {
  Range range;
  int64_t chunk;
};
Chunks chunks(int64_t count, int64_t cpu_chunk);
/// One light work-item an element: groups of 64.
inline Range elements(int64_t count) { return range1(count, 64); }

/// A buffer and where in it a strided tensor begins: two kernel arguments.
struct Strided {
  const Tensor& tensor;
};
/// One argument of many 32-bit numbers: `struct { int at[count]; }` in the kernel.
class Words {
 public:
  void add(int64_t value);
  void add_bits(uint32_t bits) { at_[count_++] = static_cast<int32_t>(bits); }
  const int32_t* data() const { return at_.data(); }
  size_t bytes() const { return count_ * sizeof(int32_t); }

 private:
  std::array<int32_t, 208> at_;  // 832 bytes: pointers share the 1,024 that a kernel's arguments may have
  size_t count_ = 0;
};

/// Sets arguments one after another and counts the bytes they name.
class Arguments {
 public:
  explicit Arguments(cl::Kernel& k) : kernel_(k) {}
  void add(const Tensor& tensor);
  void add(Strided strided);
  void add(const Words& words) { set(words.bytes(), words.data()); }
  /// A tensor read from where the words say, not from its storage's offset.
  void add_memory(const Tensor& tensor);
  void add(float value);
  template <std::integral I>
  void add(I value) {
    add_int(static_cast<int64_t>(value));
  }
  void add(uint32_t value) { set(sizeof value, &value); }
  void add(const Shape& sizes) {
    for (int64_t size : sizes) add_int(size);
  }
  double bytes() const { return bytes_; }

 private:
  void add_int(int64_t value);
  void set(size_t bytes, const void* value);
  cl::Kernel& kernel_;
  cl_uint next_ = 0;
  double bytes_ = 0;
};

/// Profile (profile.cpp): keeps a launch's event, and reads the time stamps of those that are done.
void record_launch(cl::Event event, const char* name, double flops, double bytes);
void collect_launches();

void enqueue(cl::Kernel& k, const char* name, const Range& range, double bytes);

/// Runs a kernel. Arguments in the kernel's order: tensors (dense), Strided, integers, floats.
template <class... Args>
void launch(cl::Kernel& k, const char* name, const Range& range, const Args&... args) {
  const DeviceLock lock;  // the arguments are the kernel's, until it is launched
  Arguments arguments(k);
  (arguments.add(args), ...);
  enqueue(k, name, range, arguments.bytes());
}

bool is_cpu_class();
/// CLOAM_VARIANT=reference: every op runs its version 1, the one that tests compare with.
bool reference_variants();

}  // namespace cloam
