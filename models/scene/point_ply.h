// Points of a .ply file as a cloud: x y z, and red green blue where it has them.
#pragma once
#include <filesystem>

#include "models/io/ply.h"
#include "models/scene/point_cloud.h"

namespace cloam {

/// Adds each vertex to the cloud, which must live as long as this: positions as they stand, colours as bytes, grey
/// (128) without. Vertices whose position is not finite are left out. Fault::data for a file without x, y or z.
PlyRow point_rows(const PlyHeader& header, PointCloud& cloud);

/// Binary little-endian, x y z as floats and red green blue as bytes. Fault::write.
void write_point_ply(const std::filesystem::path& path, const PointCloud& cloud);

}  // namespace cloam
