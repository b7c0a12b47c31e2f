// The course of a training as a drawing: loss, PSNR and learning rate by step, as SVG.
#pragma once
#include <filesystem>
#include <string>

#include "cli/run_history.h"

namespace cloam {

/// Legible on white and on black; empty if there is nothing to draw.
std::string curves_svg(const RunHistory& history);

/// RUN/curves.svg from the log of the run; nothing for a log without steps. Fault::data, Fault::write.
void write_curves(const std::filesystem::path& run);

}  // namespace cloam
