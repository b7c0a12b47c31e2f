// See ply.h.
#include "models/io/ply.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <numeric>
#include <set>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kLongestHeader = 1 << 16, kLongestLine = 1 << 16;
constexpr std::size_t kPlyBlock = 1 << 20;  // bytes that are read or written at once

struct NumberType {
  const char *name, *other_name;
  std::size_t bytes;
  float white;
  float (*read)(const std::uint8_t*);
};

template <class Stored>
float read_as(const std::uint8_t* bytes) {
  return static_cast<float>(number_at<Stored>(bytes));
}

constexpr NumberType kTypes[] = {
    {"char", "int8", 1, 127, read_as<std::int8_t>},
    {"uchar", "uint8", 1, 255, read_as<std::uint8_t>},
    {"short", "int16", 2, 32767, read_as<std::int16_t>},
    {"ushort", "uint16", 2, 65535, read_as<std::uint16_t>},
    {"int", "int32", 4, 2147483648.f, read_as<std::int32_t>},
    {"uint", "uint32", 4, 4294967296.f, read_as<std::uint32_t>},
    {"float", "float32", 4, 1, read_as<float>},
    {"double", "float64", 8, 1, read_as<double>},
};

// Words of one line, without the carriage return that Windows leaves.
std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (auto word = next_word(line); !word.empty(); word = next_word(line)) words.push_back(word);
  return words;
}

std::string trimmed(std::string_view words) {
  const std::size_t begin = std::min(words.find_first_not_of(" \t\r\n"), words.size());
  return std::string(words.substr(begin, words.find_last_not_of(" \t\r\n") + 1 - begin));
}

std::string listed(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + printable(name);
  return all.substr(0, 200);
}

[[noreturn]] void no_property(const std::string& file, std::string_view name, const std::vector<std::string>& names) {
  bad_data(file, ": its vertices have no property ", name, "; they have ", listed(names));
}

class Parser {
 public:
  Parser(std::streambuf& bytes, std::uint64_t size, const std::string& name) : bytes_(bytes), rest_(size) {
    header_.file = name;
  }

  void parse(const std::function<PlyRow(const PlyHeader&)>& begin) {
    read_header();
    check_size();
    const PlyRow take = begin(header_);
    if (ascii_) {
      read_ascii(take);
    } else {
      read_binary(take);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { bad_data(header_.file, ": ", why); }

  // Up to the end of the line or of the file; nothing where the line is longer.
  std::optional<std::string> line(std::size_t longest) {
    std::string found;
    for (; rest_ > 0 && found.size() < longest; --rest_) {
      const int next = bytes_.sbumpc();
      if (next == std::char_traits<char>::eof()) fail("cannot be read to its end");
      found += static_cast<char>(next);
      if (found.back() == '\n') {
        --rest_;
        return found;
      }
    }
    return rest_ > 0 ? std::nullopt : std::optional(found);
  }

  void read_header() {
    std::size_t left = kLongestHeader;
    for (bool first = true;; first = false) {
      const std::string found = line(left).value_or("");
      if (first && found != "ply\n" && found != "ply\r\n")
        fail("is not a .ply file: its first line is not 'ply'" + other_kind(found));
      if (!found.ends_with('\n')) fail(text("the .ply header has no end within ", kLongestHeader, " bytes"));
      left -= found.size();
      const auto words = words_of(found);
      if (first || words.empty() || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "comment") {
        header_.comments.push_back(trimmed(std::string_view(found).substr(found.find("comment") + 7)));
      } else {
        read_header_line(words);
      }
    }
    if (!has_format_) fail("the .ply header has no line 'format'");
    if (elements_ == 0 || types_.empty()) fail("the .ply header has no element 'vertex' with properties");
  }

  void read_header_line(const std::vector<std::string_view>& words) {
    if (words[0] == "format" && words.size() == 3) {
      ascii_ = words[1] == "ascii";
      has_format_ = true;
      if (!ascii_ && words[1] != "binary_little_endian") {
        fail(text("the format is ", printable(words[1]), ", want ascii or binary_little_endian: save the file again"));
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
    const auto count = number_in<std::uint64_t>(words[2]);
    if (!count) fail(text("the number of vertices is ", printable(words[2])));
    header_.count = *count;
  }

  void read_property(const std::vector<std::string_view>& words) {
    const auto type = std::find_if(std::begin(kTypes), std::end(kTypes), [&](const NumberType& known) {
      return words[1] == known.name || words[1] == known.other_name;
    });
    if (type == std::end(kTypes) || words.size() != 3) {
      fail(text("a vertex has a property of type ", printable(words[1]), ", want numbers"));
    }
    if (!names_.insert(std::string(words[2])).second)
      fail(text("the property ", printable(words[2]), " appears twice"));
    header_.properties.push_back({std::string(words[2]), type->white});
    types_.push_back(&*type);
  }

  std::size_t bytes_a_vertex() const {
    return std::accumulate(types_.begin(), types_.end(), std::size_t{0},
                           [](std::size_t sum, const NumberType* type) { return sum + type->bytes; });
  }

  // The count must be one that the bytes after the header can hold: only then is memory asked for.
  void check_size() const {
    // In ascii, digits and spaces; the last line may have no end.
    const std::size_t least = ascii_ ? 2 * types_.size() - 1 : bytes_a_vertex();
    if (header_.count > rest_ / least) {
      fail(text("is truncated: ", header_.count, " vertices of at least ", least, " bytes are declared, ", rest_,
                " bytes follow the header"));
    }
  }

  void read_binary(const PlyRow& take) {
    const std::size_t stride = bytes_a_vertex(), rows = std::max<std::size_t>(1, kPlyBlock / stride);
    std::vector<char> block(std::min<std::uint64_t>(rows, header_.count) * stride);
    std::vector<float> values(types_.size());
    for (std::uint64_t done = 0; done < header_.count;) {
      const std::size_t count = std::min<std::uint64_t>(rows, header_.count - done);
      const auto size = static_cast<std::streamsize>(count * stride);
      if (bytes_.sgetn(block.data(), size) != size) fail("cannot be read to its end");
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(block.data());
      for (std::size_t row = 0; row < count; ++row) {
        for (std::size_t i = 0; i < types_.size(); bytes += types_[i++]->bytes) values[i] = types_[i]->read(bytes);
        take(values);
      }
      done += count;
    }
  }

  void read_ascii(const PlyRow& take) {
    std::vector<float> values(types_.size());
    for (std::uint64_t row = 0; row < header_.count; ++row) {
      const std::optional<std::string> found = line(kLongestLine);
      if (!found) fail(text("vertex ", row, " has a line of more than ", kLongestLine, " bytes"));
      const auto words = words_of(*found);
      if (words.size() != types_.size()) {
        fail(text("vertex ", row, " has ", words.size(), " numbers, want ", types_.size()));
      }
      for (std::size_t i = 0; i < words.size(); ++i) values[i] = number(words[i], row);
      take(values);
    }
  }

  float number(std::string_view word, std::uint64_t row) const {
    const auto value = number_in<double>(word);  // 1e99 is a number, if none that a float holds
    if (!value) fail(text("vertex ", row, ": '", printable(word), "' is not a number"));
    return static_cast<float>(*value);
  }

  std::streambuf& bytes_;
  std::uint64_t rest_;  // bytes of the file that were not yet read
  PlyHeader header_;
  std::vector<const NumberType*> types_;
  std::set<std::string> names_;
  std::size_t elements_ = 0;
  bool ascii_ = false, has_format_ = false;
};

}  // namespace

std::optional<std::size_t> PlyHeader::find(std::string_view name) const {
  for (std::size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == name) return i;
  }
  return {};
}

std::size_t PlyHeader::index(std::string_view name) const {
  if (const auto found = find(name)) return *found;
  std::vector<std::string> names;
  for (const PlyProperty& property : properties) names.push_back(property.name);
  no_property(file, name, names);
}

const PlyColumn* PlyVertices::find(std::string_view name) const {
  const auto found = std::find_if(columns.begin(), columns.end(), [&](const PlyColumn& c) { return c.name == name; });
  return found == columns.end() ? nullptr : &*found;
}

const std::vector<float>& PlyVertices::column(std::string_view name) const {
  if (const PlyColumn* found = find(name)) return found->values;
  std::vector<std::string> names;
  for (const PlyColumn& column : columns) names.push_back(column.name);
  no_property(file, name, names);
}

void read_ply(const std::filesystem::path& path, const std::function<PlyRow(const PlyHeader&)>& begin) {
  const std::uint64_t size = file_bytes(path);
  std::filebuf file;
  if (!file.open(path, std::ios::in | std::ios::binary))
    bad_data(path.string(), ": cannot be opened: ", std::strerror(errno));
  Parser(file, size, path.string()).parse(begin);
}

PlyVertices read_ply_vertices(const std::filesystem::path& path) {
  PlyVertices vertices{path.string(), {}};
  read_ply(path, [&](const PlyHeader& header) -> PlyRow {
    for (const PlyProperty& property : header.properties) vertices.columns.push_back({property.name, {}});
    for (PlyColumn& column : vertices.columns) column.values.reserve(header.count);
    return [&](std::span<const float> values) {
      for (std::size_t i = 0; i < values.size(); ++i) vertices.columns[i].values.push_back(values[i]);
    };
  });
  return vertices;
}

void ply_rows(const PlyHeader& header, const std::function<void(std::size_t, std::span<float>)>& fill,
              const ByteSink& sink) {
  std::string start = "ply\nformat binary_little_endian 1.0\n";
  for (const std::string& comment : header.comments) start += "comment " + comment + "\n";
  start += text("element vertex ", header.count, "\n");
  for (const PlyProperty& property : header.properties) start += "property float " + property.name + "\n";
  start += "end_header\n";
  const std::size_t width = header.properties.size();
  const std::size_t rows = std::max<std::size_t>(1, kPlyBlock / sizeof(float) / std::max<std::size_t>(1, width));
  sink(std::as_bytes(std::span(start)));
  std::vector<float> block;
  for (std::size_t done = 0; done < header.count; done += rows) {
    const std::size_t count = std::min<std::size_t>(rows, header.count - done);
    block.resize(count * width);
    for (std::size_t row = 0; row < count; ++row) fill(done + row, std::span(block).subspan(row * width, width));
    sink(std::as_bytes(std::span(block)));
  }
}

void write_ply_rows(const std::filesystem::path& path, const PlyHeader& header,
                    const std::function<void(std::size_t, std::span<float>)>& fill) {
  commit_stream(path, [&](const ByteSink& sink) { ply_rows(header, fill, sink); });
}

void write_ply_vertices(const std::filesystem::path& path, const std::vector<PlyColumn>& columns) {
  PlyHeader header;
  for (const PlyColumn& column : columns) header.properties.push_back({column.name});
  header.count = columns.empty() ? 0 : columns.front().values.size();
  write_ply_rows(path, header, [&](std::size_t row, std::span<float> values) {
    for (std::size_t i = 0; i < columns.size(); ++i) values[i] = columns[i].values[row];
  });
}

}  // namespace cloam
