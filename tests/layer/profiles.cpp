// The profiles as data. Numbers are those that clinfo printed for the device in the places named; where the driver
// below has less, the mask shows that.
#include "tests/layer/profiles.h"

#include <algorithm>
#include <optional>

#include "tests/layer/settings.h"

namespace cloam::layer {
namespace {

constexpr cl_ulong kKiB = 1 << 10, kMiB = 1 << 20;

constexpr Profile kProfiles[] = {
    // Groups as small as cloam's GPU kernels have, the size of arguments and of local and constant memory that
    // OpenCL 1.2
    // grants any device of the full profile, and the memory of a small board.
    {"least", "the least that cloam runs on", 64, 64, 16, 32 * kKiB, 512 * kMiB, 64 * kMiB, 64 * kKiB, 1024, 1024,
     false, false, false, false},
    // github.com/ROCm/legacy-rocm-build/issues/1516 (OpenCL 3275.0)
    {"amd", "AMD RDNA 2, Radeon RX 6700 XT", 256, 1024, 32, 64 * kKiB, 12868124672, 10937905968, 10937905968, 1024,
     1024, true, true, true, true},
    // Groups and features: github.com/openvinotoolkit/openvino/issues/20012; memory: github.com/intel/compute-runtime
    // issues 586 and 627; alignment: 618; arguments: github.com/intel/intel-graphics-compiler/issues/390
    {"intel", "Intel Arc A750", 1024, 1024, 64, 64 * kKiB, 6791413760, 4144643440, 4144643440, 2048, 1024, false, true,
     true, true},
    // Groups and features: github.com/ARM-software/ComputeLibrary/issues/999 and 953; memory: that of a Mali-G610,
    // github.com/hominoids/sgminer-arm/issues/12; arguments and local memory: github.com/plaidml/plaidml/issues/182
    {"mali", "ARM Mali-G52", 384, 384, 8, 32 * kKiB, 7797280768, 7797280768, 64 * kKiB, 1024, 1024, false, true, true,
     true},
    // github.com/xmrig/xmrig/issues/2383 (Qualcomm's OpenCL 2.0 of 2020)
    {"adreno", "Qualcomm Adreno 650", 1024, 1024, 128, 32 * kKiB, 3992293376, 998073344, 64 * kKiB, 1024, 1024, false,
     true, true, false},
    // The documentation of pynufft, installation on Apple silicon (macOS 13)
    {"apple", "Apple M1", 256, 256, 32, 32 * kKiB, 11453251584, 2147483648, 1024 * kMiB, 4096, 32768, false, false,
     true, false},
    // github.com/hashcat/hashcat/issues/3916; groups, memory and alignment are those of a GeForce RTX 3090
    {"nvidia", "NVIDIA GeForce RTX 4090", 1024, 1024, 32, 48 * kKiB, 25422266368, 6355566592, 64 * kKiB, 4352, 4096,
     true, false, true, true},
};

std::optional<Profile> find() {
  const std::string& wanted = settings().profile;
  const auto group = static_cast<size_t>(std::max<int64_t>(settings().group, 0));
  const auto memory = static_cast<cl_ulong>(std::max<int64_t>(settings().memory, 0)) * kMiB;
  if (wanted.empty() && (group > 0 || memory > 0)) refuse("group=N and memory=N need profile=NAME");
  if (wanted.empty()) return std::nullopt;
  std::string names;
  for (const Profile& row : kProfiles) {
    if (wanted == row.name) {
      Profile found = row;
      if (group > 0) found.group = std::min(found.group, group), found.items = std::min(found.items, group);
      if (memory > 0) found.global_bytes = std::min(found.global_bytes, memory);
      found.largest_bytes = std::min(found.largest_bytes, found.global_bytes);
      return found;
    }
    names += std::string(" ") + row.name;
  }
  refuse("\"" + wanted + "\" is no profile; there are" + names);
}

}  // namespace

const Profile* profile() {
  static const std::optional<Profile> found = find();
  return found ? &*found : nullptr;
}

}  // namespace cloam::layer
