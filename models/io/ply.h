// The vertices of a .ply file as a table of numbers: ascii, or binary in little-endian order.
// paulbourke.net/dataformats/ply
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/io/commit.h"

namespace cloam {

struct PlyProperty {
  std::string name;  // "x"
  float white = 1;   // what stands for all of a colour: 255 of uchar, 65535 of ushort, 1 of float
};

struct PlyHeader {
  std::string file;                     // for errors
  std::vector<std::string> comments;    // without the word comment
  std::vector<PlyProperty> properties;  // of the vertices
  std::uint64_t count = 0;              // of the vertices

  std::optional<std::size_t> find(std::string_view name) const;
  /// Fault::data that lists the properties that are there.
  std::size_t index(std::string_view name) const;
};

/// Takes the values of one vertex, in the order of the properties.
using PlyRow = std::function<void(std::span<const float> values)>;

/// Reads vertex after vertex, never the whole file at once. `begin` sees the header, when the count is known to fit the
/// file's size, and returns what takes the vertices. They must be the first element, and without lists; elements after
/// them are ignored. Fault::data for what is no .ply, for one in big-endian order and for one that is cut short.
void read_ply(const std::filesystem::path& path, const std::function<PlyRow(const PlyHeader& header)>& begin);

/// Binary little-endian, all properties float; `fill` gives the values of one vertex. Replaces `path` in one step.
/// Fault::write.
void write_ply_rows(const std::filesystem::path& path, const PlyHeader& header,
                    const std::function<void(std::size_t row, std::span<float> values)>& fill);

/// The bytes of such a file, part by part.
void ply_rows(const PlyHeader& header, const std::function<void(std::size_t row, std::span<float> values)>& fill,
              const ByteSink& sink);

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

/// As write_ply_rows.
void write_ply_vertices(const std::filesystem::path& path, const std::vector<PlyColumn>& columns);

/// As read_ply, all of them.
PlyVertices read_ply_vertices(const std::filesystem::path& path);

}  // namespace cloam
