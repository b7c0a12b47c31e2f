// Views without photos, for rendering: one camera, or a path of them.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/scene/view.h"

namespace cloam {

/// A JSON file with w, h, fl_x (or camera_angle_x), and optionally fl_y, cx, cy and the lens's k1 k2 p1 p2, and either
/// transform_matrix or frames, a list of objects with one each: the keys and camera axes (OpenGL) of transforms.json,
/// any of which will do. Of runs of driving logs also time (seconds on the log's clock, 0 without) and log, the name or
/// number of one of `logs` (`log` without). Keys of a frame win over those of the file. Fault::data naming what is
/// missing.
std::vector<View> read_camera_file(const std::filesystem::path& path, const std::vector<std::string>& logs = {},
                                   int log = 0);

}  // namespace cloam
