// See data_frame.h. What pandas and numpy would build from the records of a pickle, in plain C++.
#include "models/data/data_frame.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <type_traits>

#include "models/io/bytes.h"
#include "models/io/gzip.h"
#include "models/io/npy.h"
#include "models/io/paths.h"
#include "models/io/pickle.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

using Kind = Pickle::Kind;

constexpr std::uint64_t kMaxFrameBytes = std::uint64_t{256} << 20;
constexpr std::int64_t kMaxRows = std::int64_t{1} << 24;
constexpr std::size_t kMaxColumns = 1024;
constexpr std::size_t kMaxTextBytes = std::size_t{64} << 20;
constexpr std::uint64_t kMaxCells = std::uint64_t{1} << 24;  // 128 MB of numbers; a sweep of PandaSet has a million

/// An array of numpy: of numbers as raw bytes, or of objects.
struct Array {
  std::string type;  // "f8", "i4", "b1", "O8"
  std::vector<std::int64_t> shape;
  bool columns_first = false;  // Fortran's order
  std::span<const std::uint8_t> raw;
  std::span<const PickleValue> objects;

  std::int64_t length() const {
    std::int64_t count = 1;
    for (const std::int64_t extent : shape) count *= extent;
    return count;
  }
};

template <class Stored, class Value>
std::vector<Value> converted(std::span<const std::uint8_t> raw, std::int64_t start, std::int64_t step,
                             std::int64_t count) {
  std::vector<Value> result(static_cast<std::size_t>(count));
  for (std::int64_t i = 0; i < count; ++i) {
    const std::uint8_t* at = raw.data() + static_cast<std::size_t>(start + i * step) * sizeof(Stored);
    // NOLINTNEXTLINE(bugprone-signed-char-misuse): a signed char is a number here
    result[static_cast<std::size_t>(i)] = static_cast<Value>(number_at<Stored>(at));
  }
  return result;
}

ColumnValues numeric_column(const Array& array, std::int64_t start, std::int64_t step, std::int64_t rows) {
  if (array.type == "b1") return converted<std::uint8_t, std::uint8_t>(array.raw, start, step, rows);
  ColumnValues column;
  with_numpy_kind(array.type, [&](auto number) {
    using Stored = decltype(number);
    constexpr bool whole = std::is_integral_v<Stored> && !std::is_same_v<Stored, std::uint64_t>;
    column = converted<Stored, std::conditional_t<whole, std::int64_t, double>>(array.raw, start, step, rows);
  });
  return column;
}

class FrameBuilder {
 public:
  explicit FrameBuilder(const Pickle& pickle) : pickle_(pickle), frame_(pickle.file()) {}

  DataFrame build() {
    const PickleRecord& root = pickle_.record(pickle_.root(), PickleName::data_frame, "a pandas DataFrame");
    if (!root.has_state) pickle_.unlike(pickle_.root(), "a DataFrame with a state");
    const PickleValue* manager = pickle_.find(root.state, "_mgr", "a DataFrame's state");
    if (!manager) manager = pickle_.find(root.state, "_data", "a DataFrame's state");
    if (!manager) pickle_.unlike(root.state, "_mgr or _data in a DataFrame's state");
    read_manager(*manager);
    return finish();
  }

 private:
  [[noreturn]] void fail(const PickleValue& value, const std::string& why) const {
    bad_data(pickle_.file(), ": byte ", value.offset, ": ", why);
  }

  // Since pandas 1.3: BlockManager(blocks, axes). Before: a state of four parts, the last a dict by version.
  void read_manager(const PickleValue& value) {
    const PickleRecord& manager = pickle_.record(value, PickleName::block_manager, "a pandas BlockManager");
    if (manager.arguments.size() == 2) {
      read_axes(manager.arguments[1]);
      for (const PickleValue& block : pickle_.list(manager.arguments[0], "a tuple of blocks")) read_new_block(block);
      return;
    }
    if (!manager.has_state) fail(value, "a BlockManager without blocks");
    const auto parts = pickle_.list(manager.state, "a BlockManager's state");
    const PickleValue* versioned = parts.size() == 4 ? pickle_.find(parts[3], "0.14.1", "blocks by version") : nullptr;
    if (!versioned) fail(manager.state, "looked for a BlockManager's state of pandas 0.14.1 or later");
    const PickleValue *axes = pickle_.find(*versioned, "axes", "a BlockManager's state"),
                      *blocks = pickle_.find(*versioned, "blocks", "a BlockManager's state");
    if (!axes || !blocks) fail(*versioned, "looked for axes and blocks in a BlockManager's state");
    read_axes(*axes);
    for (const PickleValue& block : pickle_.list(*blocks, "a list of blocks")) read_old_block(block);
  }

  void read_axes(const PickleValue& value) {
    const auto axes = pickle_.list(value, "a list of two axes");
    if (axes.size() != 2) fail(value, text("looked for two axes, found ", axes.size()));
    read_names(axes[0]);
  }

  void read_names(const PickleValue& value) {
    const PickleRecord& made = pickle_.record(value, PickleName::new_index, "an Index of column names");
    if (made.arguments.size() != 2) fail(value, "an Index without content");
    if (pickle_.find(made.arguments[1], "start", "an Index's content")) {  // a RangeIndex: columns have no names
      const PickleValue* stop = pickle_.find(made.arguments[1], "stop", "a RangeIndex");
      const std::int64_t count = stop ? pickle_.integer(*stop, "the end of a RangeIndex") : 0;
      if (count < 0 || count > std::int64_t(kMaxColumns)) fail(value, text(count, " columns"));
      for (std::int64_t i = 0; i < count; ++i) names_.push_back(std::to_string(i));
    } else {
      const PickleValue* data = pickle_.find(made.arguments[1], "data", "an Index's content");
      if (!data) fail(value, "an Index without data");
      const Array array = read_array(*data);
      if (array.shape.size() != 1 || array.length() > std::int64_t(kMaxColumns)) {
        fail(*data, text("looked for at most ", kMaxColumns, " column names in a row"));
      }
      names_ = as_texts(array, 0, 1, array.length());
    }
    columns_.resize(names_.size());
    filled_.resize(names_.size());
  }

  void read_new_block(const PickleValue& value) {
    const PickleRecord& block = pickle_.record(value, PickleName::unpickle_block, "a block of columns");
    if (block.arguments.size() != 3) fail(value, "looked for a block's values, places and dimensions");
    place(block.arguments[0], block.arguments[1]);
  }

  void read_old_block(const PickleValue& value) {
    const PickleValue *values = pickle_.find(value, "values", "a block of columns"),
                      *places = pickle_.find(value, "mgr_locs", "a block of columns");
    if (!values || !places) fail(value, "looked for values and mgr_locs in a block of columns");
    place(*values, *places);
  }

  void place(const PickleValue& values, const PickleValue& places_value) {
    const auto places = read_places(places_value);
    if (!is_array(values)) {  // an extension array: dates and the like
      for (const std::int64_t column : places) take(places_value, column) = std::monostate();
      return;
    }
    const Array array = read_array(values);
    const bool flat = array.shape.size() == 1 && places.size() == 1;
    if (!flat && (array.shape.size() != 2 || array.shape[0] != std::int64_t(places.size()))) {
      fail(values, text("a block for ", places.size(), " columns whose array has another shape"));
    }
    const std::int64_t rows = array.shape.back(), columns = std::int64_t(places.size());
    require_rows(values, rows);
    for (std::int64_t i = 0; i < columns; ++i) {
      const std::int64_t start = array.columns_first ? i : i * rows, step = array.columns_first && !flat ? columns : 1;
      ColumnValues& target = take(values, places[static_cast<std::size_t>(i)]);
      target = array.type[0] == 'O'      ? object_column(array, start, step, rows)
               : numpy_bytes(array.type) ? numeric_column(array, start, step, rows)
                                         : ColumnValues();
    }
  }

  void require_rows(const PickleValue& value, std::int64_t rows) {
    if (rows_ && *rows_ != rows) fail(value, text("columns of ", rows, " and of ", *rows_, " rows"));
    rows_ = rows;
    if (std::uint64_t(rows) * names_.size() > kMaxCells) {
      fail(value,
           text("a data frame of ", rows, " rows and ", names_.size(), " columns, the most is ", kMaxCells, " cells"));
    }
  }

  ColumnValues& take(const PickleValue& value, std::int64_t column) {
    if (column < 0 || column >= std::int64_t(columns_.size())) {
      fail(value, text("a block for column ", column, " of ", columns_.size()));
    }
    const auto index = static_cast<std::size_t>(column);
    if (filled_[index]) fail(value, text("two blocks for column ", column));
    filled_[index] = true;
    return columns_[index];
  }

  // A slice, or an array of whole numbers.
  std::vector<std::int64_t> read_places(const PickleValue& value) const {
    std::vector<std::int64_t> places;
    if (!pickle_.is(value, PickleName::slice)) {
      const Array array = read_array(value);
      if (array.shape.size() != 1 || array.type != "i8") fail(value, "looked for the places of a block's columns");
      if (array.length() > std::int64_t(kMaxColumns)) fail(value, text(array.length(), " columns in a block"));
      return converted<std::int64_t, std::int64_t>(array.raw, 0, 1, array.length());
    }
    const PickleRecord& slice = pickle_.record(value, "a slice");
    if (slice.arguments.size() != 3) fail(value, "looked for a slice's start, stop and step");
    const std::int64_t start = pickle_.integer(slice.arguments[0], "a slice's start"),
                       stop = pickle_.integer(slice.arguments[1], "a slice's stop"),
                       step = slice.arguments[2].kind == Kind::none
                                  ? 1
                                  : pickle_.integer(slice.arguments[2], "a slice's step");
    const std::int64_t most = std::int64_t(kMaxColumns);
    const bool sound = step > 0 && step <= most && start >= 0 && start <= most && stop >= 0 && stop <= most;
    if (!sound) fail(value, text("a slice from ", start, " to ", stop, " by ", step, " for a block's columns"));
    for (std::int64_t i = start; i < stop; i += step) places.push_back(i);
    return places;
  }

  bool is_array(const PickleValue& value) const {
    return pickle_.is(value, PickleName::reconstruct) || pickle_.is(value, PickleName::from_buffer);
  }

  // Protocols 2 to 4, and objects: _reconstruct and a state (version, shape, dtype, Fortran's order, content).
  // Protocol 5: _frombuffer(content, dtype, shape, order).
  Array read_array(const PickleValue& value) const {
    if (!is_array(value)) pickle_.unlike(value, "a numpy array");
    const PickleRecord& made = pickle_.record(value, "a numpy array");
    if (made.name == PickleName::from_buffer) {
      if (made.arguments.size() < 4) fail(value, "looked for an array's content, type, shape and order");
      const auto order = pickle_.text(made.arguments[3], "an array's order, C or F");
      if (order != "C" && order != "F") fail(value, "looked for an array's order, C or F");
      Array array = array_of(made.arguments[2], made.arguments[1], order == "F");
      array.raw = pickle_.bytes(made.arguments[0], "an array's bytes");
      require_length(value, array);
      return array;
    }
    if (!made.has_state) fail(value, "an array without content");
    const auto state = pickle_.list(made.state, "an array's state");
    if (state.size() != 5 || state[3].kind != Kind::boolean) fail(made.state, "looked for an array's state of 5 parts");
    Array array = array_of(state[1], state[2], state[3].integer != 0);
    if (array.type[0] == 'O')
      array.objects = pickle_.list(state[4], "an array's objects");
    else
      array.raw = pickle_.bytes(state[4], "an array's bytes");
    require_length(value, array);
    return array;
  }

  Array array_of(const PickleValue& shape, const PickleValue& type, bool columns_first) const {
    Array array;
    array.columns_first = columns_first;
    array.type = type_name(type);
    const auto extents = pickle_.list(shape, "an array's shape");
    if (extents.empty() || extents.size() > 2) fail(shape, text("an array of ", extents.size(), " axes, want 1 or 2"));
    for (const PickleValue& extent : extents) {
      array.shape.push_back(pickle_.integer(extent, "an array's extent"));
      if (array.shape.back() < 0 || array.shape.back() > kMaxRows) {
        fail(extent, text("an array's extent of ", array.shape.back(), ", the most is ", kMaxRows));
      }
    }
    return array;
  }

  void require_length(const PickleValue& value, const Array& array) const {
    const std::size_t size = numpy_bytes(array.type), count = static_cast<std::size_t>(array.length());
    if (size == 0 && array.type[0] != 'O') return;  // a type that is not read
    const std::size_t wanted = size ? size * count : count, found = size ? array.raw.size() : array.objects.size();
    const bool sound = wanted == found && (size || array.raw.empty());
    if (!sound) fail(value, text("an array of ", count, " values with ", found, size ? " bytes" : " objects"));
  }

  // dtype('f8', False, True) with the state (3, '<', ...). Foreign byte order and structures are not read: "?".
  std::string type_name(const PickleValue& value) const {
    const PickleRecord& type = pickle_.record(value, PickleName::dtype, "a numpy dtype");
    if (type.arguments.empty()) fail(value, "a dtype without a name");
    std::string name(pickle_.text(type.arguments[0], "a dtype's name"));
    if (name == "O8" || name == "O4" || name == "O") return "O8";
    if (!type.has_state) return "?";
    const auto state = pickle_.list(type.state, "a dtype's state");
    if (state.size() < 2) fail(type.state, "looked for a dtype's byte order");
    const auto order = pickle_.text(state[1], "a dtype's byte order");
    return numpy_bytes(name) && (order == "<" || order == "|") ? name : "?";
  }

  const PickleValue& object_at(const Array& array, std::int64_t i) const {
    return array.objects[static_cast<std::size_t>(i)];
  }

  bool may_be_text(const PickleValue& value) const {
    return value.kind == Kind::none || value.kind == Kind::text || as_number(value);
  }

  // Objects that are all numbers are numbers; else texts, with "" for None and NaN; other objects are not read.
  ColumnValues object_column(const Array& array, std::int64_t start, std::int64_t step, std::int64_t rows) {
    std::vector<double> values;
    for (std::int64_t i = 0; i < rows; ++i) {
      const PickleValue& object = object_at(array, start + i * step);
      if (!may_be_text(object)) return {};
      if (const auto value = as_number(object)) values.push_back(*value);
    }
    if (rows == 0 || values.size() < static_cast<std::size_t>(rows)) return as_texts(array, start, step, rows);
    return values;
  }

  std::optional<double> as_number(const PickleValue& value) const {
    if (value.kind == Kind::integer || value.kind == Kind::boolean) return static_cast<double>(value.integer);
    if (value.kind == Kind::real) return value.real;
    if (!pickle_.is(value, PickleName::scalar)) return {};
    const PickleRecord& scalar = pickle_.record(value, "a numpy number");
    if (scalar.arguments.size() != 2) fail(value, "looked for a number's dtype and bytes");
    Array array;
    array.type = type_name(scalar.arguments[0]);
    if (!numpy_bytes(array.type)) return {};
    array.shape = {1};
    array.raw = pickle_.bytes(scalar.arguments[1], "a number's bytes");
    require_length(value, array);
    const ColumnValues values = numeric_column(array, 0, 1, 1);
    return std::visit(
        [](const auto& one) -> std::optional<double> {
          if constexpr (requires { static_cast<double>(one[0]); }) return static_cast<double>(one[0]);
          return {};
        },
        values);
  }

  std::vector<std::string> as_texts(const Array& array, std::int64_t start, std::int64_t step, std::int64_t rows) {
    if (array.type[0] != 'O') {
      std::vector<std::string> numbers;
      if (array.type != "i8") return std::vector<std::string>(static_cast<std::size_t>(rows), "?");
      for (const auto value : converted<std::int64_t, std::int64_t>(array.raw, start, step, rows)) {
        numbers.push_back(std::to_string(value));
      }
      return numbers;
    }
    std::vector<std::string> result;
    for (std::int64_t i = 0; i < rows; ++i) result.push_back(as_text(object_at(array, start + i * step)));
    return result;
  }

  std::string as_text(const PickleValue& value) {
    if (value.kind == Kind::none) return "";
    if (const auto number = as_number(value)) return std::isnan(*number) ? "" : text(*number);
    const auto content = pickle_.text(value, "a string in a column of objects");
    // One long text that a million cells share would fill the memory.
    if ((text_bytes_ += content.size()) > kMaxTextBytes)
      fail(value, text("more than ", kMaxTextBytes, " bytes of strings"));
    return std::string(content);
  }

  DataFrame finish() {
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (!filled_[i]) fail(pickle_.root(), text("no block has the column ", printable(names_[i])));
      if (frame_.has(names_[i])) fail(pickle_.root(), text("two columns ", printable(names_[i])));
      frame_.add({names_[i], std::move(columns_[i])});
    }
    return std::move(frame_);
  }

  const Pickle& pickle_;
  DataFrame frame_;
  std::vector<std::string> names_;
  std::vector<ColumnValues> columns_;
  std::vector<bool> filled_;
  std::optional<std::int64_t> rows_;
  std::size_t text_bytes_ = 0;
};

std::size_t length_of(const ColumnValues& values) {
  return std::visit(
      [](const auto& held) -> std::size_t {
        if constexpr (requires { held.size(); }) return held.size();
        return 0;
      },
      values);
}

}  // namespace

const Column* DataFrame::find(std::string_view name) const {
  const auto found = std::find_if(columns_.begin(), columns_.end(), [&](const Column& c) { return c.name == name; });
  return found == columns_.end() ? nullptr : &*found;
}

void DataFrame::add(Column column) {
  if (has(column.name)) bad_data(file_, ": two columns ", printable(column.name));
  const bool unread = std::holds_alternative<std::monostate>(column.values);
  const bool first =
      std::all_of(columns_.begin(), columns_.end(), [](const Column& c) { return c.values.index() == 0; });
  if (!unread && first) rows_ = length_of(column.values);
  if (!unread && length_of(column.values) != rows_)
    bad_data(file_, ": the column ", printable(column.name), " has ", length_of(column.values), " rows, others have ",
             rows_);
  columns_.push_back(std::move(column));
}

const Column& DataFrame::column(std::string_view name) const {
  if (const Column* found = find(name)) return *found;
  std::string names;
  for (const Column& column : columns_) names += (names.empty() ? "" : ", ") + printable(column.name);
  bad_data(file_, ": no column ", name, "; it has ", names.substr(0, 400));
}

std::vector<double> DataFrame::numbers(std::string_view name) const {
  const Column& found = column(name);
  if (rows_ == 0) return {};
  return std::visit(
      [&](const auto& values) -> std::vector<double> {
        if constexpr (requires { static_cast<double>(values[0]); }) return {values.begin(), values.end()};
        bad_data(file_, ": the column ", name, " does not hold numbers");
      },
      found.values);
}

const std::vector<std::string>& DataFrame::texts(std::string_view name) const {
  static const std::vector<std::string> none;
  const Column& found = column(name);
  if (rows_ == 0) return none;
  if (const auto* texts = std::get_if<std::vector<std::string>>(&found.values)) return *texts;
  bad_data(file_, ": the column ", name, " does not hold strings");
}

DataFrame parse_data_frame(std::span<const std::uint8_t> bytes, const std::string& name) {
  const Pickle pickle(bytes, name);
  return FrameBuilder(pickle).build();
}

DataFrame read_data_frame(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxFrameBytes);
  return without_quotes(path, [&] {
    if (!is_gzip(bytes)) return parse_data_frame(bytes, path.string());
    return parse_data_frame(gunzip(bytes, kMaxFrameBytes, path.string()), path.string());
  });
}

}  // namespace cloam
