// Where an actor is to drive, from a file that a user wrote.
#pragma once
#include <filesystem>
#include <vector>

#include "models/scene/edit.h"

namespace cloam {

/// CSV with the head line time,x,y,z,yaw and a row a point, or a JSON list of objects with these keys; seconds, metres
/// and radians as PathPoint has them. Fault::data naming the line or entry.
std::vector<PathPoint> read_path_file(const std::filesystem::path& path);

}  // namespace cloam
