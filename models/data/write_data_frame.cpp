// The writing half of data_frame.h: opcodes of protocol 4, in the order in which pandas before 1.3 wrote them.
#include <array>
#include <bit>

#include "models/data/data_frame.h"
#include "models/io/commit.h"
#include "models/io/gzip.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Places = std::vector<std::size_t>;  // of columns in the frame

class FrameWriter {
 public:
  explicit FrameWriter(const DataFrame& frame) : frame_(frame) {}

  std::vector<std::uint8_t> write() {
    bytes("\x80\x04");
    global("pandas.core.frame", "DataFrame");
    bytes(")\x81}(");  // no arguments, NEWOBJ; a dict as state
    string("_data");
    manager();
    string("_typ");
    string("dataframe");
    string("_metadata");
    bytes("]ub.");
    return std::move(out_);
  }

 private:
  void bytes(std::string_view content) { out_.insert(out_.end(), content.begin(), content.end()); }

  template <class Number>
  void little(Number value) {
    const auto raw = std::bit_cast<std::array<std::uint8_t, sizeof(Number)>>(value);
    out_.insert(out_.end(), raw.begin(), raw.end());
  }

  void string(std::string_view content) {
    bytes("X");
    little(static_cast<std::uint32_t>(content.size()));
    bytes(content);
  }

  void global(std::string_view module, std::string_view name) {
    string(module);
    string(name);
    bytes("\x93");
  }

  void integer(std::size_t value) {
    if (value >= std::size_t{1} << 31) throw Error(Fault::internal, text("a data frame of ", value, " cells"));
    bytes("J");
    little(static_cast<std::int32_t>(value));
  }

  // The state names the values of the blocks twice; the second time from the memo.
  void manager() {
    const std::vector<Places> blocks = blocks_by_type();
    global("pandas.core.internals.managers", "BlockManager");
    bytes(")\x81(");
    axes();
    bytes("](");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      values(blocks[b]);
      bytes("q");
      little(static_cast<std::uint8_t>(b));
    }
    bytes("e](");
    for (const Places& block : blocks) names(block);
    bytes("e}");
    string("0.14.1");
    bytes("}(");
    string("axes");
    axes();
    string("blocks");
    bytes("](");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      bytes("}(");
      string("values");
      bytes("h");
      little(static_cast<std::uint8_t>(b));
      string("mgr_locs");
      places(blocks[b]);
      bytes("u");
    }
    bytes("eustb");
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
    Places all;
    for (std::size_t i = 0; i < frame_.columns().size(); ++i) all.push_back(i);
    bytes("](");
    names(all);
    global("pandas.core.indexes.base", "_new_Index");
    global("pandas.core.indexes.range", "RangeIndex");
    bytes("}(");
    string("name");
    bytes("N");
    string("start");
    integer(0);
    string("stop");
    integer(frame_.rows());
    string("step");
    integer(1);
    bytes("u\x86R");
    bytes("e");
  }

  void names(const Places& columns) {
    global("pandas.core.indexes.base", "_new_Index");
    global("pandas.core.indexes.base", "Index");
    bytes("}(");
    string("data");
    begin_array();
    integer(columns.size());
    bytes("\x85");
    object_type();
    bytes("\x89](");
    for (const std::size_t column : columns) string(frame_.columns()[column].name);
    bytes("etb");
    string("name");
    bytes("Nu\x86R");
  }

  void places(const Places& columns) {
    begin_array();
    integer(columns.size());
    bytes("\x85");
    number_type("i8", "<");
    begin_bytes(8 * columns.size());
    for (const std::size_t column : columns) little(static_cast<std::int64_t>(column));
    bytes("tb");
  }

  // One array for the columns of a type: a column a row.
  void values(const Places& columns) {
    const ColumnValues& first = frame_.columns()[columns[0]].values;
    begin_array();
    integer(columns.size());
    integer(frame_.rows());
    bytes("\x86");
    if (std::holds_alternative<std::vector<std::string>>(first)) return objects(columns);
    if (std::holds_alternative<std::vector<std::uint8_t>>(first)) return numbers<std::uint8_t>(columns, "b1", "|");
    if (std::holds_alternative<std::vector<std::int64_t>>(first)) return numbers<std::int64_t>(columns, "i8", "<");
    numbers<double>(columns, "f8", "<");
  }

  void objects(const Places& columns) {
    object_type();
    bytes("\x89](");
    for (const std::size_t column : columns) {
      for (const auto& value : std::get<std::vector<std::string>>(frame_.columns()[column].values)) string(value);
    }
    bytes("etb");
  }

  template <class Number>
  void numbers(const Places& columns, const char* type, const char* order) {
    number_type(type, order);
    begin_bytes(columns.size() * frame_.rows() * sizeof(Number));
    for (const std::size_t column : columns) {
      for (const Number value : std::get<std::vector<Number>>(frame_.columns()[column].values)) little(value);
    }
    bytes("tb");
  }

  // _reconstruct(ndarray, (0,), b"b") and the beginning of its state, (1, shape, type, order, content).
  void begin_array() {
    global("numpy.core.multiarray", "_reconstruct");
    global("numpy", "ndarray");
    bytes("K");
    little(std::uint8_t{0});
    bytes(
        "\x85"
        "C\x01"
        "b"
        "\x87R(K\x01");
  }

  void number_type(const char* type, const char* order) {
    dtype(type, order);
    bytes("J\xff\xff\xff\xffJ\xff\xff\xff\xffK");
    little(std::uint8_t{0});
    bytes("tb\x89");
  }

  void object_type() {
    dtype("O8", "|");
    bytes("J\xff\xff\xff\xffJ\xff\xff\xff\xffK\x3ftb");
  }

  void dtype(const char* type, const char* order) {
    global("numpy", "dtype");
    string(type);
    bytes("\x89\x88\x87R(K\x03");
    string(order);
    bytes("NNN");
  }

  void begin_bytes(std::size_t count) {
    if (count >> 32) throw Error(Fault::internal, text("a block of ", count, " bytes in a data frame"));
    bytes("B");
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
