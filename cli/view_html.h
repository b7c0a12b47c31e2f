// The viewer's page as one file that needs no program: Gaussians are inside, and drawn by the browser; of other methods
// pictures are.
#pragma once
#include <cstdint>
#include <filesystem>

#include "cli/view_shown.h"
#include "models/runs/listener.h"

namespace cloam {

/// Gives the file's size. Fault::usage for Gaussians where the build had no npm: its page cannot draw them.
std::uintmax_t write_view_html(const std::filesystem::path& path, Shown& shown, const Listener& listener);

}  // namespace cloam
