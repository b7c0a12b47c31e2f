// See pickle.h. Opcodes and their meaning: CPython, Lib/pickletools.py.
#include "models/io/pickle.h"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <unordered_map>

#include "models/io/bytes.h"
#include "models/io/pickle_names.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kMaxValues = std::size_t{1} << 20;  // bounds memory: some 100 bytes each at worst
constexpr std::size_t kMaxMarks = 64;                     // data frames need about ten
constexpr std::size_t kMaxOffset = std::size_t{1} << 31;

using Kind = PickleValue::Kind;

const char* kind_name(Kind kind) {
  constexpr std::array names = {"None",   "a boolean", "an integer", "a number", "a string", "bytes",
                                "a list", "a tuple",   "a dict",     "a name",   "an object"};
  return names[static_cast<std::size_t>(kind)];
}

// Where in which file the machine is, for errors.
struct Place {
  const std::string& file;
  std::size_t byte = 0;  // of the opcode

  [[noreturn]] void fail(const std::string& why) const {
    bad_data(file, ": byte ", byte, ": ", why, "; no code was executed");
  }
};

// The values that a pickle works on, with marks between them, and those that it has numbered to use again.
class Stack {
 public:
  explicit Stack(const Place& place) : place_(place) {}

  // Each value costs a byte of the file, or more, but far more of memory.
  void push(const PickleValue& value) {
    if (++made_ > kMaxValues) place_.fail(text("more than ", kMaxValues, " values are too many"));
    values_.push_back(value);
  }

  PickleValue pop() {
    const PickleValue value = top();
    values_.pop_back();
    return value;
  }

  const PickleValue& top() const {
    if (values_.size() <= (marks_.empty() ? 0 : marks_.back())) place_.fail("needs a value, the stack is empty");
    return values_.back();
  }

  void mark() {
    if (marks_.size() == kMaxMarks) place_.fail(text("nested deeper than ", kMaxMarks));
    marks_.push_back(values_.size());
  }

  std::vector<PickleValue> pop_to_mark() {
    if (marks_.empty()) place_.fail("no mark is set");
    std::vector<PickleValue> items(values_.begin() + static_cast<std::ptrdiff_t>(marks_.back()), values_.end());
    values_.resize(marks_.back());
    marks_.pop_back();
    return items;
  }

  std::vector<PickleValue> pop_items(std::size_t count) {
    std::vector<PickleValue> items(count);
    for (auto item = items.rbegin(); item != items.rend(); ++item) *item = pop();
    return items;
  }

  void memoize() { put(memo_.size()); }

  void put(std::uint64_t number) {
    if (memo_.size() >= kMaxValues) place_.fail("too many memos");
    memo_[number] = top();
  }

  void get(std::uint64_t number) {
    const auto found = memo_.find(number);
    if (found == memo_.end()) place_.fail(text("memo ", number, " was never set"));
    push(found->second);
  }

  PickleValue only() const {
    if (values_.size() != 1 || !marks_.empty()) {
      place_.fail(text("the pickle ends with ", values_.size(), " values, want 1"));
    }
    return values_.back();
  }

 private:
  const Place& place_;
  std::vector<PickleValue> values_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint64_t, PickleValue> memo_;
  std::size_t made_ = 0;
};

// Two's complement, least byte first.
std::int64_t long_integer(std::span<const std::uint8_t> digits, const Place& place) {
  if (digits.size() > 8) place.fail(text("a whole number of ", digits.size(), " bytes, want at most 8"));
  std::uint64_t value = !digits.empty() && digits.back() >= 128 ? ~std::uint64_t{0} : 0;
  for (auto digit = digits.rbegin(); digit != digits.rend(); ++digit) value = value << 8 | *digit;
  return static_cast<std::int64_t>(value);
}

std::vector<std::uint8_t> latin1(std::string_view utf8, const Place& place) {
  std::vector<std::uint8_t> result;
  result.reserve(utf8.size());
  for (std::size_t i = 0; i < utf8.size(); ++i) {
    const auto lead = static_cast<std::uint8_t>(utf8[i]);
    if (lead < 0x80) {
      result.push_back(lead);
      continue;
    }
    const bool pair = (lead == 0xc2 || lead == 0xc3) && i + 1 < utf8.size() && (utf8[i + 1] & 0xc0) == 0x80;
    if (!pair) place.fail("bytes stored as a string that is not latin1");
    result.push_back(static_cast<std::uint8_t>((lead & 3) << 6 | (utf8[++i] & 0x3f)));
  }
  return result;
}

std::string line(ByteReader& reader, const Place& place) {
  constexpr int kLongest = 256;
  std::string result;
  for (char c = 0; (c = static_cast<char>(reader.little<std::uint8_t>("a name"))) != '\n';) {
    if (result.size() == kLongest) place.fail(text("a name of more than ", kLongest, " bytes"));
    result += c;
  }
  return result;
}

void check_frame(ByteReader& reader, const Place& place) {
  const auto length = reader.little<std::uint64_t>("a frame");
  if (length > reader.remaining()) {
    place.fail(text("a frame of ", length, " bytes, ", reader.remaining(), " are left; the file is truncated"));
  }
}

}  // namespace

class PickleMachine {
 public:
  PickleMachine(Pickle& out, std::span<const std::uint8_t> bytes, PickleUse use)
      : out_(out),
        use_(use),
        dialect_(dialect_of(use)),
        bytes_(bytes),
        reader_(bytes, out.file_),
        place_{out.file_},
        stack_(place_) {}
  void run();

 private:
  using Machine = PickleMachine;
  using Action = void (*)(Machine& machine);
  struct Instruction {
    std::uint8_t opcode;
    Action action;
  };
  static const Instruction kInstructions[];

  void require_protocol() {
    const bool sound = bytes_.size() >= 2 && bytes_[0] == 0x80 && bytes_[1] >= 2 && bytes_[1] <= 5;
    if (!sound) place_.fail("looked for a pickle of protocol 2 to 5, which begins with 128 and the protocol's number");
    reader_.skip(2, "the protocol");
  }

  template <class Number>
  Number read() {
    return reader_.little<Number>("a number");
  }

  template <class Size>
  std::span<const std::uint8_t> sized(const char* what) {
    return reader_.take(reader_.little<Size>(what), what);
  }

  void push(Kind kind, std::int64_t content = 0) {
    PickleValue value;
    value.kind = kind;
    value.offset = static_cast<std::uint32_t>(place_.byte);
    value.integer = content;
    if (kind == Kind::real) value.real = std::bit_cast<double>(content);
    stack_.push(value);
  }

  void push_string(Kind kind, std::span<const std::uint8_t> content) {
    push(kind, static_cast<std::int64_t>(out_.strings_.size()));
    out_.strings_.push_back(content);
  }

  void push_list(Kind kind, std::vector<PickleValue> items) {
    push(kind, static_cast<std::int64_t>(out_.lists_.size()));
    out_.lists_.push_back(std::move(items));
  }

  void extend(Kind kind, const std::vector<PickleValue>& items) {
    const PickleValue& target = stack_.top();
    if (target.kind != kind) {
      place_.fail(text("needs ", kind_name(kind), " to add to, found ", kind_name(target.kind)));
    }
    if (kind == Kind::dict && items.size() % 2 != 0) place_.fail("a key without a value");
    auto& list = out_.lists_[static_cast<std::size_t>(target.integer)];
    list.insert(list.end(), items.begin(), items.end());
  }

  void push_global() {
    const std::string module = line(reader_, place_);
    push_name(module, line(reader_, place_));
  }

  void push_stack_global() {
    const PickleValue name = stack_.pop(), module = stack_.pop();
    push_name(out_.text(module, "a module's name"), out_.text(name, "a function's name"));
  }

  void push_name(std::string_view module, std::string_view name) {
    const std::string spelling = text(module, " ", name);
    const auto found = std::find_if(dialect_.names.begin(), dialect_.names.end(),
                                    [&](const AllowedName& allowed) { return allowed.spelling == spelling; });
    if (found == dialect_.names.end()) {
      place_.fail(text("the pickle asks for \"", printable(spelling), "\"; ", dialect_.only));
    }
    push(Kind::name, static_cast<std::int64_t>(found->name));
  }

  void record() {
    const PickleValue arguments = stack_.pop(), callee = stack_.pop();
    if (callee.kind != Kind::name) place_.fail(text("needs a name to build from, found ", kind_name(callee.kind)));
    if (arguments.kind != Kind::tuple) {
      place_.fail(text("needs a tuple of arguments, found ", kind_name(arguments.kind)));
    }
    const auto name = static_cast<PickleName>(callee.integer);
    const auto items = out_.list(arguments, "arguments");
    if (name == PickleName::encode || name == PickleName::bytes) return push_encoded(items);
    if (name == PickleName::ordered_dict) return push_ordered_dict(items);
    if (name == PickleName::size && items.size() == 1) return stack_.push(items[0]);
    push_record(name, items);
  }

  void push_record(PickleName name, std::span<const PickleValue> items) {
    if ((copied_ += items.size()) > kMaxValues) place_.fail("too many arguments");
    push(Kind::record, static_cast<std::int64_t>(out_.records_.size()));
    out_.records_.push_back({name, {items.begin(), items.end()}, {}, false});
  }

  // Python 2 makes it of a list of pairs; Python 3 makes it empty and sets its items.
  void push_ordered_dict(std::span<const PickleValue> arguments) {
    std::vector<PickleValue> content;
    for (const PickleValue& list : arguments) {
      for (const PickleValue& pair : out_.list(list, "a list of keys and values")) {
        const auto both = out_.list(pair, "a key and a value");
        if (both.size() != 2) place_.fail(text("a key and a value expected, found ", both.size(), " values"));
        content.insert(content.end(), both.begin(), both.end());
      }
      if ((copied_ += content.size()) > kMaxValues) place_.fail("too many arguments");
    }
    push_list(Kind::dict, std::move(content));
  }

  void push_persistent() {
    refuse_in_data_frames();
    const PickleValue name = stack_.pop();
    push_record(PickleName::persistent, {&name, 1});
  }

  void push_old_string(std::span<const std::uint8_t> content) {
    refuse_in_data_frames();
    push_string(Kind::text, content);
  }

  void refuse_in_data_frames() const {
    if (use_ == PickleUse::data_frame) refuse_opcode();
  }

  [[noreturn]] void refuse_opcode() const {
    place_.fail(text("opcode ", int(bytes_[place_.byte]), " is not allowed in ", dialect_.what, " (protocols 2 to 5)"));
  }

  // Before protocol 3, bytes are written as a text whose code points are the bytes.
  void push_encoded(std::span<const PickleValue> arguments) {
    if (arguments.empty()) return push_string(Kind::bytes, {});
    if (arguments.size() == 1) return push_string(Kind::bytes, out_.bytes(arguments[0], "bytes"));
    const auto coding = out_.text(arguments[1], "the name of an encoding");
    if (coding != "latin1" && coding != "latin-1") place_.fail("bytes in an encoding other than latin1");
    const std::string_view content = out_.text(arguments[0], "bytes as a string");
    // A text that is encoded again and again would fill the memory from a small file.
    if ((decoded_ += content.size()) > bytes_.size()) place_.fail("more bytes are unpacked than the file holds");
    out_.owned_.push_back(latin1(content, place_));
    push_string(Kind::bytes, out_.owned_.back());
  }

  void build() {
    const PickleValue state = stack_.pop(), target = stack_.top();
    if (use_ == PickleUse::tensors && target.kind == Kind::dict) return;  // versions of modules, beside the items
    if (target.kind != Kind::record) {
      place_.fail(text("needs an object to set the state of, found ", kind_name(target.kind)));
    }
    PickleRecord& object = out_.records_[static_cast<std::size_t>(target.integer)];
    if (object.has_state) place_.fail("sets the state of an object twice");
    object.state = state;
    object.has_state = true;
  }

  Pickle& out_;
  PickleUse use_;
  const Dialect& dialect_;
  std::span<const std::uint8_t> bytes_;
  ByteReader reader_;
  Place place_;
  Stack stack_;
  std::size_t copied_ = 0, decoded_ = 0;
};

// Whatever is not here is refused.
const PickleMachine::Instruction PickleMachine::kInstructions[] = {
    {'N', [](Machine& m) { m.push(Kind::none); }},
    {0x88, [](Machine& m) { m.push(Kind::boolean, 1); }},  // NEWTRUE
    {0x89, [](Machine& m) { m.push(Kind::boolean, 0); }},  // NEWFALSE
    {'J', [](Machine& m) { m.push(Kind::integer, m.read<std::int32_t>()); }},
    {'K', [](Machine& m) { m.push(Kind::integer, m.read<std::uint8_t>()); }},
    {'M', [](Machine& m) { m.push(Kind::integer, m.read<std::uint16_t>()); }},
    {0x8a, [](Machine& m) { m.push(Kind::integer, long_integer(m.sized<std::uint8_t>("a number"), m.place_)); }},
    {'G', [](Machine& m) { m.push(Kind::real, static_cast<std::int64_t>(m.reader_.big(8, "a number"))); }},
    {0x8c, [](Machine& m) { m.push_string(Kind::text, m.sized<std::uint8_t>("a text")); }},   // SHORT_BINUNICODE
    {'X', [](Machine& m) { m.push_string(Kind::text, m.sized<std::uint32_t>("a text")); }},   // BINUNICODE
    {0x8d, [](Machine& m) { m.push_string(Kind::text, m.sized<std::uint64_t>("a text")); }},  // BINUNICODE8
    {'C', [](Machine& m) { m.push_string(Kind::bytes, m.sized<std::uint8_t>("bytes")); }},
    {'B', [](Machine& m) { m.push_string(Kind::bytes, m.sized<std::uint32_t>("bytes")); }},
    {0x8e, [](Machine& m) { m.push_string(Kind::bytes, m.sized<std::uint64_t>("bytes")); }},  // BINBYTES8
    {0x96, [](Machine& m) { m.push_string(Kind::bytes, m.sized<std::uint64_t>("bytes")); }},  // BYTEARRAY8
    {'(', [](Machine& m) { m.stack_.mark(); }},
    {']', [](Machine& m) { m.push_list(Kind::list, {}); }},
    {'}', [](Machine& m) { m.push_list(Kind::dict, {}); }},
    {')', [](Machine& m) { m.push_list(Kind::tuple, {}); }},
    {'t', [](Machine& m) { m.push_list(Kind::tuple, m.stack_.pop_to_mark()); }},
    {0x85, [](Machine& m) { m.push_list(Kind::tuple, m.stack_.pop_items(1)); }},  // TUPLE1
    {0x86, [](Machine& m) { m.push_list(Kind::tuple, m.stack_.pop_items(2)); }},  // TUPLE2
    {0x87, [](Machine& m) { m.push_list(Kind::tuple, m.stack_.pop_items(3)); }},  // TUPLE3
    {'a', [](Machine& m) { m.extend(Kind::list, m.stack_.pop_items(1)); }},
    {'e', [](Machine& m) { m.extend(Kind::list, m.stack_.pop_to_mark()); }},
    {'s', [](Machine& m) { m.extend(Kind::dict, m.stack_.pop_items(2)); }},
    {'u', [](Machine& m) { m.extend(Kind::dict, m.stack_.pop_to_mark()); }},
    {'.', [](Machine&) {}},                                        // STOP
    {0x95, [](Machine& m) { check_frame(m.reader_, m.place_); }},  // FRAME
    {'0', [](Machine& m) { m.stack_.pop(); }},
    {'1', [](Machine& m) { m.stack_.pop_to_mark(); }},
    {'2', [](Machine& m) { m.stack_.push(m.stack_.top()); }},
    {0x94, [](Machine& m) { m.stack_.memoize(); }},
    {'q', [](Machine& m) { m.stack_.put(m.read<std::uint8_t>()); }},
    {'r', [](Machine& m) { m.stack_.put(m.read<std::uint32_t>()); }},
    {'h', [](Machine& m) { m.stack_.get(m.read<std::uint8_t>()); }},
    {'j', [](Machine& m) { m.stack_.get(m.read<std::uint32_t>()); }},
    {'c', [](Machine& m) { m.push_global(); }},
    {0x93, [](Machine& m) { m.push_stack_global(); }},
    {'R', [](Machine& m) { m.record(); }},
    {0x81, [](Machine& m) { m.record(); }},                                          // NEWOBJ
    {'Q', [](Machine& m) { m.push_persistent(); }},                                  // BINPERSID
    {'U', [](Machine& m) { m.push_old_string(m.sized<std::uint8_t>("a text")); }},   // SHORT_BINSTRING, Python 2
    {'T', [](Machine& m) { m.push_old_string(m.sized<std::uint32_t>("a text")); }},  // BINSTRING
    {'b', [](Machine& m) { m.build(); }},
};

void PickleMachine::run() {
  if (bytes_.size() > kMaxOffset) place_.fail(text("holds ", bytes_.size(), " bytes, the most is ", kMaxOffset));
  require_protocol();
  std::array<Action, 256> actions{};
  for (const Instruction& known : kInstructions) actions[known.opcode] = known.action;
  for (std::uint8_t opcode = 0; opcode != '.';) {
    place_.byte = reader_.offset();
    opcode = reader_.little<std::uint8_t>("the pickle (no STOP came)");
    if (!actions[opcode]) refuse_opcode();
    actions[opcode](*this);
  }
  out_.root_ = stack_.only();
  out_.length_ = reader_.offset();
  if (use_ == PickleUse::data_frame && reader_.remaining() > 0)
    place_.fail(text(reader_.remaining(), " bytes follow the pickle's end"));
}

Pickle::Pickle(std::span<const std::uint8_t> bytes, std::string name, PickleUse use) : file_(std::move(name)) {
  PickleMachine(*this, bytes, use).run();
}

void Pickle::unlike(const PickleValue& value, const std::string& wanted) const {
  bad_data(cloam::text(file_, ": byte ", value.offset, ": looked for ", wanted, ", found ", kind_name(value.kind)));
}

std::span<const PickleValue> Pickle::list(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::list && value.kind != Kind::tuple) unlike(value, what);
  return lists_[static_cast<std::size_t>(value.integer)];
}

std::span<const std::uint8_t> Pickle::bytes(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::bytes) unlike(value, what);
  return strings_[static_cast<std::size_t>(value.integer)];
}

std::string_view Pickle::text(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::text) unlike(value, what);
  const auto content = strings_[static_cast<std::size_t>(value.integer)];
  return {reinterpret_cast<const char*>(content.data()), content.size()};
}

std::int64_t Pickle::integer(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::integer) unlike(value, what);
  return value.integer;
}

const PickleRecord& Pickle::record(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::record) unlike(value, what);
  return records_[static_cast<std::size_t>(value.integer)];
}

const PickleRecord& Pickle::record(const PickleValue& value, PickleName name, const char* what) const {
  const PickleRecord& found = record(value, what);
  if (found.name != name) unlike(value, cloam::text(what, " (found a different object)"));
  return found;
}

PickleName Pickle::name(const PickleValue& value, const char* what) const {
  if (value.kind != Kind::name) unlike(value, what);
  return static_cast<PickleName>(value.integer);
}

std::span<const PickleValue> Pickle::items(const PickleValue& dict, const char* what) const {
  if (dict.kind != Kind::dict) unlike(dict, what);
  return lists_[static_cast<std::size_t>(dict.integer)];
}

bool Pickle::is(const PickleValue& value, PickleName name) const {
  return value.kind == Kind::record && records_[static_cast<std::size_t>(value.integer)].name == name;
}

const PickleValue* Pickle::find(const PickleValue& dict, std::string_view key, const char* what) const {
  const auto items = this->items(dict, what);
  const PickleValue* found = nullptr;  // the last of equal keys counts, as in Python
  for (std::size_t i = 0; i + 1 < items.size(); i += 2) {
    if (items[i].kind == Kind::text && text(items[i], "a key") == key) found = &items[i + 1];
  }
  return found;
}

}  // namespace cloam
