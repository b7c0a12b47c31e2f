// Meshes as files that other programs open.
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "models/mesh/mesh.h"

namespace cloam {

/// What a file says of its mesh.
struct MeshLabel {
  std::string name;
  nlohmann::ordered_json extras = nlohmann::ordered_json::object();  // how it was made
  std::string axes = "x right, y forward, z up; metres";             // of the mesh, for people
  // A rotation to x left, y up, z forward; that of an actor's box.
  Eigen::Matrix3d gltf_from_mesh{{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}};
};

/// The extensions of files that write_mesh writes.
constexpr const char* kMeshExtensions[] = {".glb", ".obj", ".ply"};

/// By the extension, one of those.
void write_mesh(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

/// Binary glTF 2.0: one mesh with POSITION, NORMAL, COLOR_0 and an unlit material, since the light is in the colours.
/// The file has glTF's axes, y up, by label.gltf_from_mesh.
/// Equal meshes and labels give equal bytes. Fault::data for a mesh without triangles or one that is over 4 GiB, which
/// glTF cannot hold; Fault::write.
void write_glb(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

/// Binary little-endian PLY with x y z nx ny nz (float) and red green blue (uchar, sRGB), in the mesh's own axes; the
/// label is a comment. Errors as write_glb.
void write_ply(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

/// The same without faces, of any number of vertices. Fault::write.
void write_points(const std::filesystem::path& path, const Mesh& points, const MeshLabel& label);

/// Wavefront OBJ as text, in the mesh's own axes: "v x y z red green blue" (sRGB in [0,1], as MeshLab and others write
/// and read colours), vn, f; the label is a comment. Errors as write_glb.
void write_obj(const std::filesystem::path& path, const Mesh& mesh, const MeshLabel& label);

}  // namespace cloam
