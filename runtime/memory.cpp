// The buffer pool: sizes are reused, our own byte budget says no before the driver aborts, and the peak is known.
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <chrono>
#include <new>
#include <optional>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/driver.h"
#include "runtime/host_memory.h"
#include "runtime/profile.h"

namespace cloam {

uint64_t wanted_max_bytes();

namespace {

constexpr uint64_t kKeptAnyway = 64 << 20;

/// Sizes go in steps of a quarter of a power of two, from 256 bytes on: sample counts that change a little from step to
/// step still find their buffer again, at most 25 % is wasted.
size_t size_class(size_t bytes) {
  if (bytes <= 256) return 0;
  const auto octave = static_cast<size_t>(std::bit_width((bytes - 1) >> 8)) - 1;
  const size_t base = size_t{256} << octave, quarter = base / 4;
  return 4 * octave + (bytes - base + quarter - 1) / quarter;
}
size_t class_bytes(size_t index) { return (size_t{256} << index / 4) / 4 * (4 + index % 4); }

struct Kept {
  cl::Buffer mem;
  uint64_t age;  // how many were freed before
};

struct Pool {
  std::array<std::vector<Kept>, 160> free;  // by size class, the oldest first
  uint64_t freed = 0;                       // buffers, so far
};
Pool& pool() {
  static Pool* const one = new Pool;  // outlives every tensor that is destroyed at exit
  return *one;
}

uint64_t default_budget() {
  // A CPU device lives in host memory: PoCL reports anything between 4 and 9 GiB on one machine, so ask the host.
  const uint64_t have = device().is_cpu ? host_free_bytes() : device().global_bytes;
  return have / 10 * 8;
}

/// A mapping whose last byte touches an unreadable page: one element past the end traps at native speed.
cl::Buffer guarded(size_t bytes) {
  const size_t page = static_cast<size_t>(sysconf(_SC_PAGESIZE));
  const size_t body = (bytes + page - 1) / page * page;
  auto* base =
      static_cast<std::byte*>(mmap(nullptr, body + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  if (base == MAP_FAILED) throw Error(Fault::memory, text("guarded buffer of ", bytes, " bytes: mmap failed"));
  mprotect(base + body, page, PROT_NONE);
  try {
    return cl::Buffer(cl_device().context, CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR, bytes, base + body - bytes);
  } catch (const cl::Error&) {
    munmap(base, body + page);
    throw;
  }
}

/// Asks for 2 MiB pages under what lies in host memory anyway: streams and columns of matrices miss fewer translations.
/// Only a hint; pages that reach past the buffer stay small.
void prefer_huge_pages(const cl::Buffer& mem, size_t bytes) {
  constexpr size_t kHuge = size_t{2} << 20;
  if (bytes < 2 * kHuge) return;
  const cl::CommandQueue& queue = cl_device().queue;
  const auto doing = [&] { return text("map a new buffer of ", bytes, " bytes"); };
  void* const at = called_again_with_room(
      doing, [&] { return queue.enqueueMapBuffer(mem, CL_TRUE, CL_MAP_WRITE_INVALIDATE_REGION, 0, bytes); });
  const auto address = reinterpret_cast<uintptr_t>(at);
  const uintptr_t begin = (address + kHuge - 1) / kHuge * kHuge, end = (address + bytes) / kHuge * kHuge;
  // NOLINTNEXTLINE(performance-no-int-to-ptr): the page that the address lies in
  madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
  called_again_with_room(doing, [&] { queue.enqueueUnmapMemObject(mem, at); });
}

cl::Buffer fresh(size_t bytes) {
  const ClDevice& cl = cl_device();
  if (!cl.info.is_cpu) return cl::Buffer(cl.context, CL_MEM_READ_WRITE, bytes);
  if (debug().bounds) return guarded(bytes);
  // A plain buffer is lazy here and aborts the process at first use when memory is short.
  return {cl.context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR, bytes};
}

[[noreturn]] void too_much(size_t bytes, const char* why) {
  const DeviceStats& s = device_stats();
  throw Error(Fault::memory, text("out of memory: ", why, " for a buffer of ", bytes >> 20, " MiB; in use ",
                                  s.live_bytes >> 20, " MiB of a budget of ", memory_budget() >> 20,
                                  " MiB.\n  fix: train with a larger --downscale or smaller --set batch.*, or raise "
                                  "--max-memory if the machine has more"));
}

/// A free buffer of this class or of one up to half as large again; `index` becomes its class.
std::optional<cl::Buffer> reuse(size_t& index) {
  for (size_t i = index; i < index + 3; i++) {
    std::vector<Kept>& shelf = pool().free[i];
    if (shelf.empty()) continue;
    index = i;
    cl::Buffer mem = std::move(shelf.back().mem);
    shelf.pop_back();
    device_stats().kept_bytes -= class_bytes(i);
    return mem;
  }
  return std::nullopt;
}

/// The class whose oldest free buffer has lain longest.
size_t oldest_class() {
  size_t oldest = 0;
  uint64_t age = ~uint64_t{0};
  for (size_t i = 0; i < pool().free.size(); i++)
    if (!pool().free[i].empty() && pool().free[i].front().age < age) age = pool().free[oldest = i].front().age;
  return oldest;
}

/// Gives back what has lain longest, until no more than `most` bytes are kept.
void keep_at_most(uint64_t most) {
  DeviceStats& s = device_stats();
  if (s.kept_bytes <= most) return;
  finish();
  while (s.kept_bytes > most) {
    const size_t index = oldest_class();
    std::vector<Kept>& shelf = pool().free[index];
    shelf.erase(shelf.begin());
    s.kept_bytes -= class_bytes(index);
  }
}

cl::Buffer obtain(size_t size) {
  if (size > device().max_alloc_bytes && !device().is_cpu)
    too_much(size, "larger than the device's largest allocation");
  // Sizes that change from step to step would fill all classes: what is kept stays below what was ever needed at once.
  keep_at_most(std::max(device_stats().peak_bytes, kKeptAnyway));
  if (device_stats().live_bytes + device_stats().kept_bytes + size > memory_budget()) trim_memory();
  if (device_stats().live_bytes + size > memory_budget()) too_much(size, "over the budget");
  cl::Buffer mem =
      called_again_with_room([&] { return text("make a buffer of ", size, " bytes"); }, [&] { return fresh(size); });
  if (device().is_cpu && !debug().bounds) prefer_huge_pages(mem, size);
  device_stats().allocated_bytes += size;
  return mem;
}

void poison(const cl::Buffer& mem, size_t bytes) {
  called_again_with_room([&] { return text("fill a buffer of ", bytes, " bytes"); },
                         [&] { cl_device().queue.enqueueFillBuffer(mem, 0x7fc00000u, 0, bytes / 4 * 4); });
}

}  // namespace

uint64_t memory_budget() {
  const DeviceLock lock;
  static const uint64_t budget = default_budget();
  return wanted_max_bytes() ? wanted_max_bytes() : budget;
}

namespace {

std::shared_ptr<Buffer> lent(cl::Buffer mem, size_t bytes) {
  auto buffer = std::make_shared<Buffer>(std::move(mem), bytes);
  DeviceStats& s = device_stats();
  s.live_bytes += bytes;
  s.peak_bytes = std::max(s.peak_bytes, s.live_bytes);
  if (debug().poison) poison(buffer->mem, bytes);
  return buffer;
}

}  // namespace

std::shared_ptr<Buffer> allocate(size_t bytes) {
  const DeviceLock lock;
  if (bytes > memory_budget()) too_much(bytes, "over the budget");
  size_t index = size_class(bytes);
  std::optional<cl::Buffer> found = reuse(index);
  const size_t real = class_bytes(index);
  return lent(found ? std::move(*found) : obtain(real), real);
}

std::shared_ptr<Buffer> allocate_to_stay(size_t bytes) {
  const DeviceLock lock;
  constexpr size_t kUnit = 256;
  if (bytes > memory_budget()) too_much(bytes, "over the budget");
  const size_t real = std::max<size_t>(1, (bytes + kUnit - 1) / kUnit) * kUnit;
  auto buffer = lent(obtain(real), real);
  buffer->pooled = false;
  return buffer;
}

std::shared_ptr<Buffer> buffer_in(std::shared_ptr<std::byte> memory, size_t bytes) {
  const DeviceLock lock;
  const auto doing = [&] { return text("make a buffer in ", bytes, " bytes of the host"); };
  auto buffer =
      lent(called_again_with_room(doing,
                                  [&] {
                                    return cl::Buffer(cl_device().context, CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR,
                                                      bytes, memory.get());
                                  }),
           bytes);
  buffer->given = std::move(memory);
  buffer->pooled = false;
  return buffer;
}

Buffer::~Buffer() {
  if (whole) return;
  const DeviceLock lock;
  DeviceStats& s = device_stats();
  s.live_bytes -= bytes;
  // Launches that are under way still use the memory, which is not the driver's.
  if (given && !left_by_fork()) clFinish(cl_device().queue());
  if (!pooled) return;
  try {
    pool().free[size_class(bytes)].push_back({std::move(mem), pool().freed++});
    s.kept_bytes += bytes;
  } catch (const std::bad_alloc&) {  // the host has no memory for the list: then it is given back
  }
}

void trim_memory() {
  const DeviceLock lock;
  finish();
  for (std::vector<Kept>& shelf : pool().free) shelf.clear();
  device_stats().kept_bytes = 0;
}

bool make_room() {
  try {
    trim_memory();
    return true;
  } catch (const Error&) { return false; }
}

namespace {

/// Counts the time in which the host is blocked, whatever comes of it.
struct WaitTimer {
  HostSpan span{"wait"};
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  ~WaitTimer() {
    device_stats().waits++;
    device_stats().wait_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
};

std::string after_launches() { return text(" after these launches, the last one first: ", last_launches()); }

}  // namespace

void read_buffer(const Buffer& buffer, size_t offset, size_t bytes, void* to) {
  const DeviceLock lock;
  const WaitTimer timer;
  if (bytes)
    called([&] { return text("read ", bytes, " bytes of a buffer", after_launches()); },
           [&] { cl_device().queue.enqueueReadBuffer(buffer.mem, CL_TRUE, offset, bytes, to); });
  collect_launches();
}

void write_buffer(const Buffer& buffer, const void* from, size_t bytes) {
  const DeviceLock lock;
  if (bytes)
    called_again_with_room([&] { return text("write ", bytes, " bytes into a buffer"); },
                           [&] { cl_device().queue.enqueueWriteBuffer(buffer.mem, CL_TRUE, 0, bytes, from); });
}

namespace {

/// Bytes of a buffer that the host sees until this ends.
class Mapped {
 public:
  Mapped(const Buffer& buffer, size_t offset, size_t bytes, HostUse kind) : mem_(buffer.mem) {
    const WaitTimer timer;
    const cl_map_flags flags = kind == HostUse::read     ? CL_MAP_READ
                               : kind == HostUse::change ? CL_MAP_READ | CL_MAP_WRITE
                                                         : CL_MAP_WRITE_INVALIDATE_REGION;
    called([&] { return text("map ", bytes, " bytes of a buffer", after_launches()); },
           [&] { at_ = cl_device().queue.enqueueMapBuffer(mem_, CL_TRUE, flags, offset, bytes); });
  }
  ~Mapped() {
    if (!at_ || left_by_fork()) return;
    const DeviceLock lock;
    clEnqueueUnmapMemObject(cl_device().queue(), mem_(), at_, 0, nullptr, nullptr);
  }
  Mapped(const Mapped&) = delete;
  Mapped& operator=(const Mapped&) = delete;
  std::byte* at() const { return static_cast<std::byte*>(at_); }
  void end() {
    void* const at = std::exchange(at_, nullptr);
    called([] { return std::string("unmap a buffer"); }, [&] { cl_device().queue.enqueueUnmapMemObject(mem_, at); });
  }

 private:
  cl::Buffer mem_;
  void* at_ = nullptr;
};

}  // namespace

void use_on_host(const Buffer& buffer, size_t offset, size_t bytes, HostUse kind,
                 const std::function<void(std::span<std::byte>)>& use) {
  if (bytes == 0) return use({});
  const DeviceLock lock;
  if (device().shares_host_memory) {
    Mapped mapped(buffer, offset, bytes, kind);
    collect_launches();
    use({mapped.at(), bytes});
    return mapped.end();
  }
  std::vector<std::byte> copy(bytes);
  if (kind != HostUse::overwrite) read_buffer(buffer, offset, bytes, copy.data());
  use(copy);
  if (kind != HostUse::read)
    called_again_with_room(
        [&] { return text("write ", bytes, " bytes into a buffer"); },
        [&] { cl_device().queue.enqueueWriteBuffer(buffer.mem, CL_TRUE, offset, bytes, copy.data()); });
}

std::shared_ptr<const std::byte> mapped_to_read(const std::shared_ptr<Buffer>& buffer, size_t bytes) {
  struct Held {
    std::shared_ptr<Buffer> buffer;  // goes back to the pool once it is no longer mapped
    Mapped mapped;
  };
  const DeviceLock lock;
  const auto held = std::shared_ptr<Held>(new Held{buffer, {*buffer, 0, bytes, HostUse::read}});
  return {held, held->mapped.at()};
}

void finish() {
  const DeviceLock lock;
  const WaitTimer timer;
  called([] { return "wait for the device" + after_launches(); }, [] { cl_device().queue.finish(); });
  collect_launches();
}

void synchronize() { finish(); }

}  // namespace cloam
