// What `cloam doctor` looks at before it asks OpenCL: files of drivers, graphics cards and who may use them.
#pragma once
#include <string>
#include <vector>

#include "runtime/device.h"

namespace cloam {

struct Finding {
  enum State { fine, problem } state = fine;
  std::string what, found;
  std::string fix;  // of a problem: what to type or to do
};
using Findings = std::vector<Finding>;

/// The OpenCL loader's files (*.icd in $OCL_ICD_VENDORS or /etc/OpenCL/vendors): each names a library, which must load.
/// Two that name one library are two drivers for one device.
Findings check_drivers();
/// The graphics cards on the PCI bus: each needs its files in /dev, permission to open them, and a device among
/// `devices`.
Findings check_cards(const std::vector<DeviceInfo>& devices);
/// OpenCL 1.2, room for kernels and for data, and no second driver for the same device.
Findings check_devices(const std::vector<DeviceInfo>& devices);
/// PoCL ends the whole program where it cannot link a kernel: whether it does is tried in a program apart, if PATH has
/// no linker.
Findings check_linker(const std::vector<DeviceInfo>& devices);
/// $CLOAM_SYSTEM_ROOT stands before /etc, /dev and /sys: tests have a machine of their own there.
std::string system_path(const std::string& path);

}  // namespace cloam
