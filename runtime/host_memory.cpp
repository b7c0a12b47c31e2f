// See host_memory.h.
#include "runtime/host_memory.h"

#include <algorithm>
#include <fstream>
#include <string>

namespace cloam {
namespace {

constexpr uint64_t kNoLimit = ~uint64_t{0};

uint64_t available_bytes() {
  std::ifstream info("/proc/meminfo");
  std::string key;
  uint64_t kib = 0;
  for (std::string unit; info >> key >> kib;) {
    if (key == "MemAvailable:") return kib * 1024;
    std::getline(info, unit);
  }
  return kNoLimit;
}

/// The number a file holds; `otherwise` where it holds none ("max") or does not exist.
uint64_t number_in(const char* path, uint64_t otherwise) {
  std::ifstream file(path);
  uint64_t number = 0;
  return file >> number ? number : otherwise;
}

/// Of version 2, as containers and batch systems set it. docs.kernel.org/admin-guide/cgroup-v2.html
uint64_t left_in_group() {
  const uint64_t most = number_in("/sys/fs/cgroup/memory.max", kNoLimit);
  if (most == kNoLimit) return kNoLimit;
  return most - std::min(most, number_in("/sys/fs/cgroup/memory.current", 0));
}

}  // namespace

uint64_t host_free_bytes() { return std::min(available_bytes(), left_in_group()); }

}  // namespace cloam
