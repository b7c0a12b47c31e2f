// Where PoCL keeps the kernels that it has compiled. Without a folder that it can write it offers no device at all, and
// on a full disk it ends the process; so it is given another folder before its first call.
#pragma once
#include <string>

namespace cloam {

struct KernelCache {
  std::string note;    // one line for the user; empty: PoCL's own folder serves
  bool usable = true;  // false: neither its own folder nor a temporary one does, and the note says why
};

/// Decided at the first call, which must come before the first OpenCL call: sets POCL_CACHE_DIR where PoCL's own choice
/// ($POCL_CACHE_DIR, $XDG_CACHE_HOME/pocl, ~/.cache/pocl) cannot be written or has too little room. What is set then
/// is a folder of this user alone below the folder for temporary files; later runs find what it holds.
const KernelCache& kernel_cache();

}  // namespace cloam
