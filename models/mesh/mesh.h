// Surfaces of triangles with colours.
#pragma once
#include <cstdint>
#include <vector>

namespace cloam {

/// V vertices and T triangles, which run counter-clockwise seen from outside. Right-handed axes, metres.
struct Mesh {
  std::vector<float> positions;          // [V,3]
  std::vector<float> normals;            // [V,3], of length 1, outwards
  std::vector<float> colours;            // [V,3] in [0,1], as in images (sRGB)
  std::vector<std::uint32_t> triangles;  // [T,3]

  std::size_t vertex_count() const { return positions.size() / 3; }
  std::size_t triangle_count() const { return triangles.size() / 3; }
};

}  // namespace cloam
