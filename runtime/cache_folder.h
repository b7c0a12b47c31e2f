// The folder of what programs of this user keep for each other.
#pragma once
#include <string>

namespace cloam {

/// $CLOAM_CACHE_DIR, $XDG_CACHE_HOME/cloam or ~/.cache/cloam; it need not exist.
std::string cache_folder();

}  // namespace cloam
