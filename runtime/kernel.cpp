// The kernel cache and launch(): kernels/<stem>.cl by constants, and generated text, each compiled once a process.
#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <thread>
#include <unordered_map>

#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/device_lock.h"
#include "runtime/driver.h"
#include "runtime/float64.h"
#include "runtime/profile.h"

namespace cloam {

struct KernelSource {
  const char* stem;
  const char* text;
};
extern const KernelSource kKernelSources[];

namespace {

const char* embedded_text(const std::string& stem) {
  for (const KernelSource* source = kKernelSources; source->stem; source++)
    if (stem == source->stem) return source->text;
  return nullptr;
}

}  // namespace

bool has_kernel_text(const std::string& stem) { return embedded_text(stem) != nullptr; }

std::vector<std::string> kernel_stems() {
  std::vector<std::string> out;
  for (const KernelSource* source = kKernelSources; source->stem; source++) out.push_back(source->stem);
  return out;
}

std::string kernel_text(const std::string& stem) {
  if (const char* folder = std::getenv("CLOAM_KERNEL_DIR")) {
    std::ifstream file(std::string(folder) + "/" + stem + ".cl");
    if (file) return {std::istreambuf_iterator<char>(file), {}};
  }
  if (const char* embedded = embedded_text(stem)) return embedded;
  throw Error(Fault::internal, text("[kernel] there is no kernels/", stem, ".cl"));
}

namespace {

struct Compiled {
  cl::Program program;
  std::map<std::string, cl::Kernel> kernels;
};
struct Cache {
  std::map<std::pair<std::string, Constants>, Compiled> files;
  std::unordered_map<std::string, cl::Kernel> generated;
};
Cache& cache() {
  static Cache* const one = new Cache;
  return *one;
}

thread_local std::set<std::string>* kernel_recorder = nullptr;  // of what this thread launches

/// "conv2d_cpu.cl: conv2d_rows", or what a generated kernel is made of.
std::string name_of(const cl::Kernel& k, const char* label) {
  for (const auto& [file, compiled] : cache().files)
    for (const auto& [name, known] : compiled.kernels)
      if (known() == k()) return file.first + ".cl: " + name;
  return text("generated: ", label);
}

std::string options(const Constants& constants) {
  std::string out = std::string("-cl-std=CL1.2 -w -DCLOAM_CPU=") + (is_cpu_class() ? "1" : "0");
  if (debug().float64) out += " -DCLOAM_FLOAT64=1";
  for (const auto& [name, value] : constants) out += text(" -D", name, "=", value);
  if (const char* extra = std::getenv("CLOAM_BUILD_OPTIONS")) out += text(" ", extra);
  return out;
}

std::string numbered(const std::string& source) {
  std::string out;
  int line = 1;
  size_t at = 0;
  for (size_t end; at < source.size() && (end = source.find('\n', at)) != std::string::npos; at = end + 1)
    out += text(line++, ": ", source.substr(at, end - at), "\n");
  return out;
}

std::function<void(const DeviceStats&)>& build_listener() {
  static std::function<void(const DeviceStats&)> listener;
  return listener;
}

std::string log_of(const cl::Program& program) {
  std::string log;
  try {
    log = program.getBuildInfo<CL_PROGRAM_BUILD_LOG>(cl_device().device);
  } catch (const cl::Error& error) { log = text("no log: ", code_text(error.err())); }
  while (!log.empty() && (log.back() == '\0' || std::isspace(static_cast<unsigned char>(log.back())))) log.pop_back();
  return log;
}

/// The compiler's messages as further lines of an error.
std::string indented(std::string log) {
  if (log.empty()) log = "the compiler says nothing; PoCL does so when POCL_CACHE_DIR is full or cannot be written";
  std::string out = "\n    ";
  for (const char c : log) out += c == '\n' ? "\n    " : std::string(1, c);
  return out;
}

[[noreturn]] void build_failed(cl_int code, const std::string& what, const std::string& source, const std::string& with,
                               const std::string& log) {
  if (debug().kernels) std::fprintf(stderr, "%s", numbered(source).c_str());
  const char* const more = std::getenv("POCL_EXTRA_BUILD_FLAGS");
  throw Error(Fault::device,
              text("cannot compile ", what, " on ", device().name, ": clBuildProgram gave ", code_text(code),
                   " with the options ", with, more ? text(" and POCL_EXTRA_BUILD_FLAGS=", more) : "", indented(log),
                   "\n  fix: ", more ? "unset POCL_EXTRA_BUILD_FLAGS, " : "",
                   "update the device's driver, or select another device (cloam info lists them); "
                   "CLOAM_DEBUG=kernels shows the source"));
}

cl_int compiled(const cl::Program& program, const std::string& with) {
  const cl_device_id on = cl_device().device();
  const cl_int code = clBuildProgram(program(), 1, &on, with.c_str(), nullptr, nullptr);
  if (code != CL_SUCCESS && code != CL_BUILD_PROGRAM_FAILURE && code != CL_INVALID_BUILD_OPTIONS)
    throw cl::Error(code, "clBuildProgram");
  return code;
}

/// PoCL's processes share a folder of compiled kernels: one in twenty-five builds failed where eight of them compiled
/// the same kernels at once, without a word of the compiler, and the next attempt found what the others had made.
constexpr int kAttempts = 4;
bool may_succeed_later(cl_int code, const std::string& log) {
  return code == CL_BUILD_PROGRAM_FAILURE && log.find("error:") == std::string::npos;
}

cl::Program build(const std::string& what, const std::string& source, const Constants& constants) {
  const HostSpan span("build");
  const WatchedBuild watched;
  const auto start = std::chrono::steady_clock::now();
  const std::string with = options(constants), text_of_kernels = debug().float64 ? in_float64(source) : source;
  const auto doing = [&] { return text("compile ", what); };
  cl::Program program;
  for (int attempt = 1;; attempt++) {
    program = called_again_with_room(doing, [&] { return cl::Program(cl_device().context, text_of_kernels); });
    const cl_int code = called_again_with_room(doing, [&] { return compiled(program, with); });
    if (code == CL_SUCCESS) break;
    const std::string log = log_of(program);
    if (attempt == kAttempts || !may_succeed_later(code, log)) build_failed(code, what, source, with, log);
    std::this_thread::sleep_for(std::chrono::milliseconds(20 << attempt));
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  device_stats().build_seconds += seconds;
  if (debug().kernels) std::fprintf(stderr, "[build] %s %.0f ms\n", what.c_str(), seconds * 1e3);
  if (build_listener()) build_listener()(device_stats());
  return program;
}

cl::Kernel kernel_in(const cl::Program& program, const std::string& name) {
  return called_again_with_room([&] { return text("make the kernel ", name); },
                                [&] { return cl::Kernel(program, name.c_str()); });
}

}  // namespace

void record_kernels(std::set<std::string>* into) { kernel_recorder = into; }

void on_build(std::function<void(const DeviceStats&)> listener) {
  const DeviceLock lock;
  build_listener() = std::move(listener);
}

cl::Kernel& kernel(const char* stem, const char* name, const Constants& constants) {
  const DeviceLock lock;
  Compiled& compiled = cache().files[{stem, constants}];
  if (!compiled.program())
    compiled.program = build(text("kernels/", stem, ".cl"), kernel_text("prelude") + kernel_text(stem), constants);
  const auto known = compiled.kernels.find(name);
  if (known != compiled.kernels.end()) return known->second;
  cl::Kernel fresh = kernel_in(compiled.program, name);
  device_stats().kernels_built++;
  return compiled.kernels.emplace(name, std::move(fresh)).first->second;
}

/// Nothing is kept of kernels that could not be built: a later call tries again.
void build_generated(const std::vector<Generated>& kernels) {
  // Not contracted: a * b - c * d of equal operands is 0 then.
  std::string source = kernel_text("prelude") + "#pragma OPENCL FP_CONTRACT OFF\n";
  std::map<std::string, cl::Kernel> made;
  for (const Generated& k : kernels)
    if (!cache().generated.contains(k.name) && made.try_emplace(k.name).second) source += k.source;
  if (made.empty()) return;
  const cl::Program program =
      build(made.size() == 1 ? "a generated kernel" : text(made.size(), " generated kernels"), source, {});
  for (auto& [name, k] : made) k = kernel_in(program, name);
  for (auto& [name, k] : made) cache().generated.emplace(name, std::move(k));
  device_stats().kernels_built += static_cast<int64_t>(made.size());
}

cl::Kernel& generated_kernel(const Generated& wanted) {
  auto found = cache().generated.find(wanted.name);
  if (found != cache().generated.end()) return found->second;
  build_generated({wanted});
  return cache().generated.at(wanted.name);
}

Range range1(int64_t items, int64_t local) {
  Range r;
  r.local[0] = static_cast<size_t>(local);
  r.global[0] = static_cast<size_t>((items + local - 1) / local * local);
  return r;
}

Chunks chunks(int64_t count, int64_t cpu_chunk) {
  if (!is_cpu_class()) return {range1(count, 64), 1};
  return {range1((count + cpu_chunk - 1) / cpu_chunk), cpu_chunk};
}

Range range2(int64_t x, int64_t y) {
  Range r;
  r.global[0] = static_cast<size_t>(x);
  r.global[1] = static_cast<size_t>(y);
  return r;
}

namespace {

std::string function_name(const cl::Kernel& k) {
  try {
    return k.getInfo<CL_KERNEL_FUNCTION_NAME>();
  } catch (const cl::Error&) { return "without a name"; }
}

}  // namespace

void Arguments::set(size_t bytes, const void* value) {
  const cl_uint place = next_++;
  called_again_with_room([&] { return text("set argument ", place, " of the kernel ", function_name(kernel_)); },
                         [&] { kernel_.setArg(place, bytes, value); });
}

void Arguments::add(const Tensor& tensor) {
  const Storage& s = tensor.node()->storage;
  if (!s.buffer || s.offset != 0) throw Error(Fault::internal, "[launch] a kernel argument is not evaluated and dense");
  set(sizeof(cl_mem), &s.buffer->mem());
  bytes_ += static_cast<double>(tensor.numel()) * static_cast<double>(size_of(tensor.dtype()));
}

void Arguments::add(float value) {
  const double wide = value;
  if (debug().float64)
    set(sizeof wide, &wide);
  else
    set(sizeof value, &value);
}

void Arguments::add(Strided strided) {
  add_memory(strided.tensor);
  add_int(strided.tensor.node()->storage.offset);
}

void Arguments::add_memory(const Tensor& tensor) {
  set(sizeof(cl_mem), &tensor.node()->storage.buffer->mem());
  bytes_ += static_cast<double>(tensor.numel()) * static_cast<double>(size_of(tensor.dtype()));
}

namespace {

cl_int in_31_bits(int64_t value) {
  if (value > std::numeric_limits<int32_t>::max() || value < std::numeric_limits<int32_t>::min())
    throw Error(Fault::memory,
                text("[launch] a size of ", value, " elements does not fit 31 bits: use a smaller batch"));
  return static_cast<cl_int>(value);
}

}  // namespace

void Arguments::add_int(int64_t value) {
  const cl_int word = in_31_bits(value);
  set(sizeof word, &word);
}

void Words::add(int64_t value) { at_[count_++] = in_31_bits(value); }

namespace {

/// A ring of names: who fails may be among the last.
struct LastLaunches {
  std::array<const char*, 4> names{};
  size_t count = 0;
};
LastLaunches& last_launched() {
  static LastLaunches one;
  return one;
}

double milliseconds(const cl::Event& event, const char* name) {
  return called([&] { return text("time the kernel ", name); },
                [&] {
                  event.wait();
                  return 1e-6 * static_cast<double>(event.getProfilingInfo<CL_PROFILING_COMMAND_END>() -
                                                    event.getProfilingInfo<CL_PROFILING_COMMAND_START>());
                });
}

void profile_line(const char* name, const Range& range, double bytes, const cl::Event& event) {
  const double ms = milliseconds(event, name);
  std::fprintf(stderr, "[launch] %-28s %9.3f ms %8.2f GB/s %8.2f GFLOP/s  range %zux%zux%zu\n", name, ms,
               bytes / ms * 1e-6, range.flops / ms * 1e-6, range.global[0], range.global[1], range.global[2]);
}

std::string words_for(const char* name, const Range& range) {
  return text("launch the kernel ", name, " over ", range.global[0], "x", range.global[1], "x", range.global[2],
              " items in groups of ", range.local[0], "x", range.local[1], "x", range.local[2]);
}

}  // namespace

std::string last_launches() {
  const LastLaunches& last = last_launched();
  std::string out;
  for (size_t i = 0; i < std::min(last.count, last.names.size()); i++)
    out += text(i > 0 ? ", " : "", last.names[(last.count - 1 - i) % last.names.size()]);
  return out.empty() ? "nothing" : out;
}

void enqueue(cl::Kernel& k, const char* name, const Range& range, double bytes) {
  if (range.global[0] * range.global[1] * range.global[2] == 0) return;
  if (kernel_recorder) kernel_recorder->insert(name_of(k, name));
  const cl::NDRange global(range.global[0], range.global[1], range.global[2]);
  const cl::NDRange local(range.local[0], range.local[1], range.local[2]);
  cl::Event event;
  cl::Event* const timed = debug().kernels || profiling() ? &event : nullptr;
  called_again_with_room(
      [&] { return words_for(name, range); },
      [&] { cl_device().queue.enqueueNDRangeKernel(k, cl::NullRange, global, local, nullptr, timed); });
  device_stats().launches++;
  last_launched().names[last_launched().count++ % last_launched().names.size()] = name;
  if (debug().kernels)
    profile_line(name, range, bytes, event);
  else if (timed)
    record_launch(std::move(event), name, range.flops, bytes);
  if (debug().sync) finish();
}

}  // namespace cloam
