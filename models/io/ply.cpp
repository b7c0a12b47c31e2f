// See ply.h.
#include "models/io/ply.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <set>

#include "models/io/commit.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kLongestHeader = 1 << 16;

struct NumberType {
  const char *name, *other_name;
  std::size_t bytes;
  float (*read)(const std::uint8_t*);
};

template <class Stored>
float read_as(const std::uint8_t* bytes) {
  Stored value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<float>(value);
}

constexpr NumberType kTypes[] = {
    {"char", "int8", 1, read_as<std::int8_t>},    {"uchar", "uint8", 1, read_as<std::uint8_t>},
    {"short", "int16", 2, read_as<std::int16_t>}, {"ushort", "uint16", 2, read_as<std::uint16_t>},
    {"int", "int32", 4, read_as<std::int32_t>},   {"uint", "uint32", 4, read_as<std::uint32_t>},
    {"float", "float32", 4, read_as<float>},      {"double", "float64", 8, read_as<double>},
};

// Words of one line, without the carriage return that Windows leaves.
std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    line.remove_prefix(std::min(line.find_first_not_of(" \t\r"), line.size()));
    if (line.empty()) return words;
    words.push_back(line.substr(0, line.find_first_of(" \t\r")));
    line.remove_prefix(words.back().size());
  }
}

class Parser {
 public:
  Parser(std::span<const std::uint8_t> bytes, const std::string& name)
      : rest_(reinterpret_cast<const char*>(bytes.data()), bytes.size()) {
    vertices_.file = name;
  }

  PlyVertices parse() {
    read_header();
    if (ascii_) {
      read_ascii();
    } else {
      read_binary();
    }
    return std::move(vertices_);
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { throw Error(Fault::data, text(vertices_.file, ": ", why)); }

  std::string_view next_line(std::size_t longest) {
    const std::size_t end = rest_.substr(0, longest).find('\n');
    if (end == std::string_view::npos) fail(text("the .ply header has no end within ", kLongestHeader, " bytes"));
    const std::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(end + 1);
    return line;
  }

  void read_header() {
    if (!rest_.starts_with("ply\n") && !rest_.starts_with("ply\r\n")) fail("is no .ply: its first line is not 'ply'");
    const std::size_t size = rest_.size();
    next_line(kLongestHeader);
    while (true) {
      const std::size_t used = size - rest_.size();
      const auto words = words_of(next_line(kLongestHeader - std::min(used, kLongestHeader)));
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      read_header_line(words);
    }
    if (!has_format_) fail("the .ply header has no line 'format'");
    if (elements_ == 0 || columns_.empty()) fail("the .ply header has no element 'vertex' with properties");
  }

  void read_header_line(const std::vector<std::string_view>& words) {
    if (words[0] == "format" && words.size() == 3) {
      ascii_ = words[1] == "ascii";
      has_format_ = true;
      if (!ascii_ && words[1] != "binary_little_endian") {
        fail(text("the format is ", printable(words[1]), ", want ascii or binary_little_endian: save the file anew"));
      }
    } else if (words[0] == "element" && words.size() == 3) {
      if (elements_++ == 0) read_element(words);
    } else if (words[0] == "property" && words.size() >= 3 && elements_ > 0) {
      if (elements_ == 1) read_property(words);
    } else {
      fail(text("the .ply header has the line '", printable(words[0]), " ...', want format, element or property"));
    }
  }

  void read_element(const std::vector<std::string_view>& words) {
    if (words[1] != "vertex") fail(text("its first element is ", printable(words[1]), ", want vertex"));
    const auto [end, error] = std::from_chars(words[2].data(), words[2].data() + words[2].size(), count_);
    if (error != std::errc() || end != words[2].data() + words[2].size()) {
      fail(text("the number of vertices is ", printable(words[2])));
    }
  }

  void read_property(const std::vector<std::string_view>& words) {
    const auto type = std::find_if(std::begin(kTypes), std::end(kTypes), [&](const NumberType& known) {
      return words[1] == known.name || words[1] == known.other_name;
    });
    if (type == std::end(kTypes) || words.size() != 3) {
      fail(text("a vertex has a property of type ", printable(words[1]), ", want numbers"));
    }
    if (!names_.insert(std::string(words[2])).second) fail(text("two properties ", printable(words[2])));
    vertices_.columns.push_back({std::string(words[2]), {}});
    columns_.push_back(&*type);
  }

  // Of a count that the bytes after the header can hold: only then is memory asked for.
  void reserve(std::size_t least_bytes_a_vertex) {
    if (count_ > rest_.size() / least_bytes_a_vertex) {
      fail(text("ends too early: ", count_, " vertices of at least ", least_bytes_a_vertex, " bytes are promised, ",
                rest_.size(), " bytes follow the header"));
    }
    for (PlyColumn& column : vertices_.columns) column.values.resize(count_);
  }

  void read_binary() {
    std::size_t stride = 0;
    for (const NumberType* type : columns_) stride += type->bytes;
    reserve(stride);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(rest_.data());
    for (std::size_t row = 0; row < count_; ++row) {
      for (std::size_t i = 0; i < columns_.size(); ++i) {
        vertices_.columns[i].values[row] = columns_[i]->read(bytes);
        bytes += columns_[i]->bytes;
      }
    }
  }

  void read_ascii() {
    reserve(2 * columns_.size() - 1);  // digits and spaces; the last line may have no end
    for (std::size_t row = 0; row < count_; ++row) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      const auto words = words_of(rest_.substr(0, end));
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      if (words.size() != columns_.size()) {
        fail(text("vertex ", row, " has ", words.size(), " numbers, want ", columns_.size()));
      }
      for (std::size_t i = 0; i < words.size(); ++i) vertices_.columns[i].values[row] = number(words[i], row);
    }
  }

  float number(std::string_view word, std::size_t row) const {
    double value = 0;  // 1e99 is a number, if none that a float holds
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) {
      fail(text("vertex ", row, ": '", printable(word), "' is no number"));
    }
    return static_cast<float>(value);
  }

  std::string_view rest_;
  PlyVertices vertices_;
  std::vector<const NumberType*> columns_;
  std::set<std::string> names_;
  std::size_t count_ = 0, elements_ = 0;
  bool ascii_ = false, has_format_ = false;
};

}  // namespace

const PlyColumn* PlyVertices::find(std::string_view name) const {
  const auto found = std::find_if(columns.begin(), columns.end(), [&](const PlyColumn& c) { return c.name == name; });
  return found == columns.end() ? nullptr : &*found;
}

const std::vector<float>& PlyVertices::column(std::string_view name) const {
  if (const PlyColumn* found = find(name)) return found->values;
  std::string names;
  for (const PlyColumn& c : columns) names += (names.empty() ? "" : ", ") + printable(c.name);
  throw Error(Fault::data, text(file, ": its vertices have no property ", name, "; they have ", names.substr(0, 200)));
}

PlyVertices parse_ply(std::span<const std::uint8_t> bytes, const std::string& name) {
  return Parser(bytes, name).parse();
}

void write_ply_vertices(const std::filesystem::path& path, const std::vector<PlyColumn>& columns) {
  const std::size_t rows = columns.empty() ? 0 : columns.front().values.size();
  std::string content = text("ply\nformat binary_little_endian 1.0\nelement vertex ", rows, "\n");
  for (const PlyColumn& column : columns) content += "property float " + column.name + "\n";
  content += "end_header\n";
  for (std::size_t row = 0; row < rows; ++row) {
    for (const PlyColumn& column : columns) {
      char bytes[sizeof(float)];
      std::memcpy(bytes, &column.values[row], sizeof bytes);
      content.append(bytes, sizeof bytes);
    }
  }
  commit_text(path, content);
}

}  // namespace cloam
