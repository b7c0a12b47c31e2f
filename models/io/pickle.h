// Python's pickles, protocols 2 to 5, read as plain data. A pickle is a program for a stack machine that may name any
// function and call it; this interpreter calls nothing. A name must stand in a closed list (data frames of pandas,
// arrays of numpy), and what a pickle wants built with it becomes a record of name, arguments and state.
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
  other,  // known and harmless, but no column that we read has it: dates, categories
};

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

  /// Runs the whole pickle. It must hold one value and end with it. `name` (a file) stands at the head of errors, which
  /// are all Fault::data with the byte where the trouble lies. The bytes must outlive the Pickle.
  Pickle(std::span<const std::uint8_t> bytes, std::string name);

  const PickleValue& root() const { return root_; }
  const std::string& file() const { return file_; }

  // Each checks the kind; `what` says in words what was looked for.
  std::span<const PickleValue> list(const PickleValue& value, const char* what) const;  // or tuple
  std::span<const std::uint8_t> bytes(const PickleValue& value, const char* what) const;
  std::string_view text(const PickleValue& value, const char* what) const;
  std::int64_t integer(const PickleValue& value, const char* what) const;
  const PickleRecord& record(const PickleValue& value, const char* what) const;
  const PickleRecord& record(const PickleValue& value, PickleName name, const char* what) const;
  /// The value under a key that is a text, or null.
  const PickleValue* find(const PickleValue& dict, std::string_view key, const char* what) const;

  bool is(const PickleValue& value, PickleName name) const;

  /// Throws: `wanted` was looked for at the value's byte, the value was found.
  [[noreturn]] void unlike(const PickleValue& value, const std::string& wanted) const;

 private:
  friend class PickleMachine;

  std::string file_;
  PickleValue root_;
  std::vector<std::span<const std::uint8_t>> strings_;  // texts and bytes: parts of the file, or of owned_
  std::deque<std::vector<std::uint8_t>> owned_;
  std::vector<std::vector<PickleValue>> lists_;  // lists, tuples, and dicts as key, value, key, value
  std::vector<PickleRecord> records_;
};

}  // namespace cloam
