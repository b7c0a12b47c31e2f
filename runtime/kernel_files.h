// Compiled kernels that PoCL keeps on the disk: it ends the process when one of them is no longer whole.
#pragma once
#include <filesystem>

namespace cloam {

/// Removes the programs below PoCL's folder of which a file is cut off or empty, or zeros stand at its ends (a power
/// cut, a full disk); PoCL compiles them again. Gives their number. Files that an earlier call found whole, and that
/// were not changed since, are not opened again, nor those of a kernel that PoCL compiled for no other size since and
/// ten minutes before. Never throws: what cannot be read or removed stays.
int remove_damaged_kernels(const std::filesystem::path& folder);

}  // namespace cloam
