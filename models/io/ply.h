// The vertices of a .ply file as a table of numbers: ascii, or binary in little-endian order.
// paulbourke.net/dataformats/ply
#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

struct PlyColumn {
  std::string name;           // "x"
  std::vector<float> values;  // one a vertex
};

struct PlyVertices {
  std::string file;  // for errors
  std::vector<PlyColumn> columns;

  const PlyColumn* find(std::string_view name) const;
  /// Fault::data that lists the columns that are there.
  const std::vector<float>& column(std::string_view name) const;
};

/// Binary little-endian, each column a float property. Replaces `path` in one step. Fault::write.
void write_ply_vertices(const std::filesystem::path& path, const std::vector<PlyColumn>& columns);

/// `name` (a file) stands at the head of errors. Vertices must be the first element, and without lists; elements after
/// them are ignored. Fault::data for what is no .ply, for one in big-endian order and for one that is cut short.
PlyVertices parse_ply(std::span<const std::uint8_t> bytes, const std::string& name);

}  // namespace cloam
