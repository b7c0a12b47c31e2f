// Python's pickles, protocols 2 to 5, read as plain data. A pickle is a program for a stack machine that may name any
// function and call it; this interpreter calls nothing. A name must stand in a closed list (data frames of pandas and
// arrays of numpy, or tensors of PyTorch), and what a pickle wants built with it becomes a record of name, arguments
// and state.
#pragma once
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

/// The names that a pickle may hold; several spellings of one thing (old and new module paths) are one.
enum class PickleName {
  data_frame,
  block_manager,
  unpickle_block,
  new_index,
  index,
  range_index,
  reconstruct,
  from_buffer,
  scalar,
  array,
  dtype,
  slice,
  encode,
  bytes,
  persistent,  // what the file holds beside the pickle, by whatever names it there
  tensor,
  parameter,
  ordered_dict,
  size,
  storage_f64,
  storage_f32,
  storage_f16,
  storage_bf16,
  storage_i64,
  storage_i32,
  storage_i16,
  storage_i8,
  storage_u8,
  storage_bool,
  other,  // known and harmless, but no column that we read has it: dates, categories
};

/// What a pickle is read for, which decides the names that it may hold.
enum class PickleUse { data_frame, tensors };

/// One value. Containers and records lie in the Pickle and are named by their place there, so that a value is small,
/// and deep or circular pickles need no recursion.
struct PickleValue {
  enum class Kind : std::uint8_t { none, boolean, integer, real, text, bytes, list, tuple, dict, name, record };
  Kind kind = Kind::none;
  std::uint32_t offset = 0;  // of the byte that made it, for errors
  union {
    std::int64_t integer = 0;  // also boolean, name (PickleName) and the place of all that lies in the Pickle
    double real;
  };
};

/// What REDUCE, NEWOBJ and BUILD would have made.
struct PickleRecord {
  PickleName name = PickleName::other;
  std::vector<PickleValue> arguments;
  PickleValue state;
  bool has_state = false;
};

class Pickle {
 public:
  using Kind = PickleValue::Kind;

  /// Runs the pickle that the bytes begin with. It must hold one value and end with it; a data frame also ends the
  /// bytes. `name` (a file) stands at the head of errors, which are all Fault::data with the byte where the trouble
  /// lies. The bytes must outlive the Pickle.
  Pickle(std::span<const std::uint8_t> bytes, std::string name, PickleUse use = PickleUse::data_frame);

  const PickleValue& root() const { return root_; }
  const std::string& file() const { return file_; }
  std::size_t length() const { return length_; }  // bytes up to its end
  std::span<const PickleRecord> records() const { return records_; }

  // Each checks the kind; `what` says in words what was looked for.
  std::span<const PickleValue> list(const PickleValue& value, const char* what) const;  // or tuple
  std::span<const std::uint8_t> bytes(const PickleValue& value, const char* what) const;
  std::string_view text(const PickleValue& value, const char* what) const;
  std::int64_t integer(const PickleValue& value, const char* what) const;
  const PickleRecord& record(const PickleValue& value, const char* what) const;
  const PickleRecord& record(const PickleValue& value, PickleName name, const char* what) const;
  PickleName name(const PickleValue& value, const char* what) const;
  /// key, value, key, value and so on.
  std::span<const PickleValue> items(const PickleValue& dict, const char* what) const;
  /// The value under a key that is a text, or null.
  const PickleValue* find(const PickleValue& dict, std::string_view key, const char* what) const;

  bool is(const PickleValue& value, PickleName name) const;

  /// Throws: `wanted` was looked for at the value's byte, the value was found.
  [[noreturn]] void unlike(const PickleValue& value, const std::string& wanted) const;

 private:
  friend class PickleMachine;

  std::string file_;
  std::size_t length_ = 0;
  PickleValue root_;
  std::vector<std::span<const std::uint8_t>> strings_;  // texts and bytes: parts of the file, or of owned_
  std::deque<std::vector<std::uint8_t>> owned_;
  std::vector<std::vector<PickleValue>> lists_;  // lists, tuples, and dicts as key, value, key, value
  std::vector<PickleRecord> records_;
};

}  // namespace cloam
