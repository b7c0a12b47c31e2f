// The writing half of data_frame.h: opcodes of protocol 4, in the order in which pandas before 1.3 wrote them.
#include <array>
#include <bit>
#include <numeric>

#include "models/data/data_frame.h"
#include "models/io/commit.h"
#include "models/io/gzip.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using namespace std::string_view_literals;
using Places = std::vector<std::size_t>;  // of columns in the frame

struct Word {
  std::string_view content;
};

struct Name {
  const char *module, *name;
};

// Of numpy: "f8" with the order of its bytes.
struct Type {
  std::string_view name, order;
};

// _reconstruct(ndarray, (0,), b"b") and the beginning of its state, (1, shape, type, order, content).
struct BeginArray {};

constexpr BeginArray kBeginArray;
constexpr Type kObjects{"O8", "|"};
constexpr Name kNewIndex{"pandas.core.indexes.base", "_new_Index"};

class FrameWriter {
 public:
  explicit FrameWriter(const DataFrame& frame) : frame_(frame) {}

  std::vector<std::uint8_t> write() {
    // No arguments, NEWOBJ; a dict as state.
    put("\x80\x04", Name{"pandas.core.frame", "DataFrame"}, ")\x81}(", Word{"_data"});
    manager();
    put(Word{"_typ"}, Word{"dataframe"}, Word{"_metadata"}, "]ub.");
    return std::move(out_);
  }

 private:
  template <class... Parts>
  void put(const Parts&... parts) {
    (add(parts), ...);
  }

  void add(std::string_view opcodes) { out_.insert(out_.end(), opcodes.begin(), opcodes.end()); }

  void add(const Word& word) {
    add("X");
    little(static_cast<std::uint32_t>(word.content.size()));
    add(word.content);
  }

  void add(const Name& name) { put(Word{name.module}, Word{name.name}, "\x93"); }

  void add(std::size_t value) {
    if (value >= std::size_t{1} << 31) throw Error(Fault::internal, text("a data frame of ", value, " cells"));
    add("J");
    little(static_cast<std::int32_t>(value));
  }

  template <class Number>
  void little(Number value) {
    const auto raw = std::bit_cast<std::array<std::uint8_t, sizeof(Number)>>(value);
    out_.insert(out_.end(), raw.begin(), raw.end());
  }

  // The state names the values of the blocks twice; the second time from the memo.
  void manager() {
    const std::vector<Places> blocks = blocks_by_type();
    put(Name{"pandas.core.internals.managers", "BlockManager"}, ")\x81(");
    axes();
    put("](");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      values(blocks[b]);
      put("q");
      little(static_cast<std::uint8_t>(b));
    }
    put("e](");
    for (const Places& block : blocks) names(block);
    put("e}", Word{"0.14.1"}, "}(", Word{"axes"});
    axes();
    put(Word{"blocks"}, "](");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      put("}(", Word{"values"}, "h");
      little(static_cast<std::uint8_t>(b));
      put(Word{"mgr_locs"});
      places(blocks[b]);
      put("u");
    }
    put("eustb");
  }

  std::vector<Places> blocks_by_type() const {
    std::vector<Places> blocks;
    for (std::size_t type = 1; type < std::variant_size_v<ColumnValues>; ++type) {
      Places block;
      for (std::size_t i = 0; i < frame_.columns().size(); ++i) {
        if (frame_.columns()[i].values.index() == type) block.push_back(i);
      }
      if (!block.empty()) blocks.push_back(block);
    }
    return blocks;
  }

  void axes() {
    Places all(frame_.columns().size());
    std::iota(all.begin(), all.end(), 0);
    put("](");
    names(all);
    put(kNewIndex, Name{"pandas.core.indexes.range", "RangeIndex"}, "}(", Word{"name"}, "N", Word{"start"}, 0,
        Word{"stop"}, frame_.rows(), Word{"step"}, 1, "u\x86Re");
  }

  void names(const Places& columns) {
    put(kNewIndex, Name{"pandas.core.indexes.base", "Index"}, "}(", Word{"data"});
    put(kBeginArray, columns.size(), "\x85", kObjects, "\x89](");
    for (const std::size_t column : columns) put(Word{frame_.columns()[column].name});
    put("etb", Word{"name"}, "Nu\x86R");
  }

  void places(const Places& columns) {
    put(kBeginArray, columns.size(), "\x85", Type{"i8", "<"});
    begin_bytes(8 * columns.size());
    for (const std::size_t column : columns) little(static_cast<std::int64_t>(column));
    put("tb");
  }

  // One array for the columns of a type: a column a row.
  void values(const Places& columns) {
    const ColumnValues& first = frame_.columns()[columns[0]].values;
    put(kBeginArray, columns.size(), frame_.rows(), "\x86");
    if (std::holds_alternative<std::vector<std::string>>(first)) return objects(columns);
    if (std::holds_alternative<std::vector<std::uint8_t>>(first)) return numbers<std::uint8_t>(columns, {"b1", "|"});
    if (std::holds_alternative<std::vector<std::int64_t>>(first)) return numbers<std::int64_t>(columns, {"i8", "<"});
    numbers<double>(columns, {"f8", "<"});
  }

  void objects(const Places& columns) {
    put(kObjects, "\x89](");
    for (const std::size_t column : columns) {
      for (const auto& value : std::get<std::vector<std::string>>(frame_.columns()[column].values)) put(Word{value});
    }
    put("etb");
  }

  template <class Number>
  void numbers(const Places& columns, const Type& type) {
    put(type);
    begin_bytes(columns.size() * frame_.rows() * sizeof(Number));
    for (const std::size_t column : columns) {
      for (const Number value : std::get<std::vector<Number>>(frame_.columns()[column].values)) little(value);
    }
    put("tb");
  }

  void add(const BeginArray&) {
    put(Name{"numpy.core.multiarray", "_reconstruct"}, Name{"numpy", "ndarray"},
        "K\0\x85"
        "C\x01"
        "b\x87R(K\x01"sv);
  }

  void add(const Type& type) {
    put(Name{"numpy", "dtype"}, Word{type.name}, "\x89\x88\x87R(K\x03", Word{type.order}, "NNN",
        "J\xff\xff\xff\xffJ\xff\xff\xff\xffK");
    type.name == kObjects.name ? put("\x3ftb") : put("\0tb\x89"sv);
  }

  void begin_bytes(std::size_t count) {
    if (count >> 32) throw Error(Fault::internal, text("a block of ", count, " bytes in a data frame"));
    put("B");
    little(static_cast<std::uint32_t>(count));
  }

  const DataFrame& frame_;
  std::vector<std::uint8_t> out_;
};

}  // namespace

std::vector<std::uint8_t> pickle_data_frame(const DataFrame& frame) { return FrameWriter(frame).write(); }

void write_data_frame(const std::filesystem::path& path, const DataFrame& frame) {
  const auto packed = gzip(pickle_data_frame(frame));
  commit_bytes(path, std::as_bytes(std::span(packed)));
}

}  // namespace cloam
