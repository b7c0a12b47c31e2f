// The kernel cache and launch(): kernels/<stem>.cl by constants, and generated text, each compiled once a process.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <unordered_map>

#include "runtime/cl.h"
#include "runtime/debug.h"
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

std::set<std::string>* recorder = nullptr;

/// "conv2d_cpu.cl: conv2d_rows", or what a generated kernel is made of.
std::string name_of(const cl::Kernel& k, const char* label) {
  for (const auto& [file, compiled] : cache().files)
    for (const auto& [name, known] : compiled.kernels)
      if (known() == k()) return file.first + ".cl: " + name;
  return text("generated: ", label);
}

std::string options(const Constants& constants) {
  std::string out = std::string("-cl-std=CL1.2 -w -DCLOAM_CPU=") + (is_cpu_class() ? "1" : "0");
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

cl::Program build(const std::string& what, const std::string& source, const Constants& constants) {
  const HostSpan span("build");
  const auto start = std::chrono::steady_clock::now();
  cl::Program program(cl_device().context, source);
  try {
    program.build({cl_device().device}, options(constants).c_str());
  } catch (const cl::Error& e) {
    throw Error(Fault::device,
                text("[kernel ", what, "] does not compile on ", device().name, " (", e.err(), "), options ",
                     options(constants), "\n", program.getBuildInfo<CL_PROGRAM_BUILD_LOG>(cl_device().device), "\n",
                     numbered(source)));
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  device_stats().build_seconds += seconds;
  if (debug().kernels) std::fprintf(stderr, "[build] %s %.0f ms\n", what.c_str(), seconds * 1e3);
  if (build_listener()) build_listener()(device_stats());
  return program;
}

}  // namespace

void record_kernels(std::set<std::string>* into) { recorder = into; }

void on_build(std::function<void(const DeviceStats&)> listener) { build_listener() = std::move(listener); }

cl::Kernel& kernel(const char* stem, const char* name, const Constants& constants) {
  Compiled& compiled = cache().files[{stem, constants}];
  if (!compiled.program()) compiled.program = build(stem, kernel_text("prelude") + kernel_text(stem), constants);
  auto [at, fresh] = compiled.kernels.try_emplace(name);
  if (fresh) {
    at->second = cl::Kernel(compiled.program, name);
    device_stats().kernels_built++;
  }
  return at->second;
}

void build_generated(const std::vector<Generated>& kernels) {
  std::string source = kernel_text("prelude");
  std::vector<const Generated*> missing;
  for (const Generated& k : kernels)
    if (cache().generated.try_emplace(k.name).second) {
      missing.push_back(&k);
      source += k.source;
    }
  if (missing.empty()) return;
  cl::Program program = build(text(missing.size(), " generated"), source, {});
  for (const Generated* k : missing) cache().generated[k->name] = cl::Kernel(program, k->name.c_str());
  device_stats().kernels_built += static_cast<int64_t>(missing.size());
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

void Arguments::add(const Tensor& tensor) {
  const Storage& s = tensor.node()->storage;
  if (!s.buffer || s.offset != 0) throw Error(Fault::internal, "[launch] a kernel argument is not evaluated and dense");
  kernel_.setArg(next_++, s.buffer->mem);
  bytes_ += static_cast<double>(tensor.numel()) * static_cast<double>(size_of(tensor.dtype()));
}

void Arguments::add(Strided strided) {
  add_memory(strided.tensor);
  add_int(strided.tensor.node()->storage.offset);
}

void Arguments::add_memory(const Tensor& tensor) {
  kernel_.setArg(next_++, tensor.node()->storage.buffer->mem);
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

void Arguments::add_int(int64_t value) { kernel_.setArg(next_++, in_31_bits(value)); }

void Words::add(int64_t value) { at_[count_++] = in_31_bits(value); }

namespace {

void profile_line(const char* name, const Range& range, double bytes, const cl::Event& event) {
  event.wait();
  const double ms = 1e-6 * static_cast<double>(event.getProfilingInfo<CL_PROFILING_COMMAND_END>() -
                                               event.getProfilingInfo<CL_PROFILING_COMMAND_START>());
  std::fprintf(stderr, "[launch] %-28s %9.3f ms %8.2f GB/s %8.2f GFLOP/s  range %zux%zux%zu\n", name, ms,
               bytes / ms * 1e-6, range.flops / ms * 1e-6, range.global[0], range.global[1], range.global[2]);
}

}  // namespace

void enqueue(cl::Kernel& k, const char* name, const Range& range, double bytes) {
  if (range.global[0] * range.global[1] * range.global[2] == 0) return;
  device_stats().launches++;
  if (recorder) recorder->insert(name_of(k, name));
  const cl::NDRange global(range.global[0], range.global[1], range.global[2]);
  const cl::NDRange local(range.local[0], range.local[1], range.local[2]);
  try {
    if (debug().kernels) {
      cl::Event event;
      cl_device().queue.enqueueNDRangeKernel(k, cl::NullRange, global, local, nullptr, &event);
      profile_line(name, range, bytes, event);
    } else if (profiling()) {
      cl::Event event;
      cl_device().queue.enqueueNDRangeKernel(k, cl::NullRange, global, local, nullptr, &event);
      record_launch(std::move(event), name, range.flops, bytes);
    } else {
      cl_device().queue.enqueueNDRangeKernel(k, cl::NullRange, global, local);
    }
    if (debug().sync) finish();
  } catch (const cl::Error& e) {
    throw Error(Fault::device, text("[launch ", name, "] ", e.what(), " gave ", e.err(), " for a range of ",
                                    range.global[0], "x", range.global[1], "x", range.global[2], " in groups of ",
                                    range.local[0], "x", range.local[1], " on ", device().name));
  }
}

}  // namespace cloam
