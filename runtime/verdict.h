// What `selftest` found of a device, kept in the cache folder: shown by `info` and before a training. A device that
// computes wrong results is refused; where the reference version of a kernel is right, its faster variants are switched
// off.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "runtime/device.h"

namespace cloam {

/// A family of kernels whose variants gave wrong results where its reference gives right ones.
struct SwitchedOff {
  std::string family, op_row;  // the op row that showed it
};

struct Verdict {
  std::string when;  // UTC
  bool quick = false;
  int rows = 0;                     // that were checked
  std::vector<std::string> failed;  // rows that are wrong with the references, too
  std::vector<SwitchedOff> off;
  bool passed() const { return failed.empty(); }
};

/// What was found of this device with this driver, device class and these kernels; nothing if it was never tested, or
/// not since one of them changed.
std::optional<Verdict> verdict_of(const DeviceInfo& device);
/// Where that is kept: $CLOAM_CACHE_DIR or $XDG_CACHE_HOME/cloam or ~/.cache/cloam.
std::string verdict_file(const DeviceInfo& device);
/// What verdict_file() is to hold.
std::string file_text(const Verdict& verdict, const DeviceInfo& device);

/// "passed selftest --quick on 2026-11-25, 1 kernel family switched off", "failed selftest on 2026-11-25", "never
/// tested".
std::string words_of(const std::optional<Verdict>& verdict);

}  // namespace cloam
