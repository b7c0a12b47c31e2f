// Meshes as files that other programs open.
#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "models/mesh/mesh.h"

namespace cloam {

/// What a file says of its mesh.
struct MeshLabel {
  std::string name;
  nlohmann::ordered_json extras = nlohmann::ordered_json::object();  // how it was made
};

/// Binary glTF 2.0: one mesh with POSITION, NORMAL, COLOR_0 and an unlit material, since the light is in the colours.
/// The mesh has the axes of an actor's box (x right, y forward, z up); the file has glTF's (y up, z forward, x left).
/// Equal meshes and labels give equal bytes. Fault::data for a mesh without triangles or one that is over 4 GiB, which
/// glTF cannot hold; Fault::write.
void write_glb(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

/// Binary little-endian PLY with x y z nx ny nz (float) and red green blue (uchar, sRGB), in the mesh's own axes; the
/// label is a comment. Errors as write_glb.
void write_ply(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

}  // namespace cloam
