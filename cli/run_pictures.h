// Pictures that show a trained run all around, made at the end of a training and by `cloam report`.
#pragma once
#include <filesystem>
#include <vector>

#include "cli/common.h"
#include "models/runs/restore_run.h"

namespace cloam {

/// Photos: RUN/turntable.gif, an orbit. Driving logs: RUN/drive.gif along the front camera's way, RUN/assets.png with
/// the actors that most images show, and RUN/turntable.gif of the first of them. Diffusion: RUN/assets.png with eight
/// generated assets, RUN/turntable.gif of the first. Small; smaller and of fewer frames where all would take longer
/// than `seconds` (except for the sampling of a diffusion); none where even few would: a line says so. The files.
/// Errors of the device, Fault::data if the run that a diffusion learned from is gone, Fault::write.
std::vector<std::filesystem::path> make_pictures(RestoredRun& run, double seconds, const Common& common);

}  // namespace cloam
