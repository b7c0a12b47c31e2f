// See pickle.h. Opcodes and their meaning: CPython, Lib/pickletools.py.
#include "models/io/pickle.h"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <unordered_map>

#include "models/io/bytes.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kMostValues = std::size_t{1} << 20;  // bounds memory: some 100 bytes each at worst
constexpr std::size_t kMostMarks = 64;                     // data frames need about ten
constexpr std::size_t kMostOffset = std::size_t{1} << 31;

struct AllowedName {
  std::string_view spelling;  // module, space, name
  PickleName name;
};

// Whatever is not here is refused by name. Old and new spellings: numpy 2 moved numpy.core, pandas 0.20 and 2 indexes.
constexpr AllowedName kAllowed[] = {
    {"pandas.core.frame DataFrame", PickleName::data_frame},
    {"pandas.core.internals.managers BlockManager", PickleName::block_manager},
    {"pandas.core.internals BlockManager", PickleName::block_manager},
    {"pandas._libs.internals _unpickle_block", PickleName::unpickle_block},
    {"pandas.core.indexes.base _new_Index", PickleName::new_index},
    {"pandas.indexes.base _new_Index", PickleName::new_index},
    {"pandas.core.indexes.base Index", PickleName::index},
    {"pandas.indexes.base Index", PickleName::index},
    {"pandas.core.indexes.numeric Int64Index", PickleName::index},
    {"pandas.core.indexes.numeric UInt64Index", PickleName::index},
    {"pandas.core.indexes.numeric Float64Index", PickleName::index},
    {"pandas.indexes.numeric Int64Index", PickleName::index},
    {"pandas.core.indexes.range RangeIndex", PickleName::range_index},
    {"pandas.indexes.range RangeIndex", PickleName::range_index},
    {"numpy.core.multiarray _reconstruct", PickleName::reconstruct},
    {"numpy._core.multiarray _reconstruct", PickleName::reconstruct},
    {"numpy.core.numeric _frombuffer", PickleName::from_buffer},
    {"numpy._core.numeric _frombuffer", PickleName::from_buffer},
    {"numpy.core.multiarray scalar", PickleName::scalar},
    {"numpy._core.multiarray scalar", PickleName::scalar},
    {"numpy ndarray", PickleName::array},
    {"numpy dtype", PickleName::dtype},
    {"builtins slice", PickleName::slice},
    {"__builtin__ slice", PickleName::slice},
    {"_codecs encode", PickleName::encode},
    {"builtins bytes", PickleName::bytes},
    {"__builtin__ bytes", PickleName::bytes},
    {"builtins bytearray", PickleName::bytes},
    {"__builtin__ bytearray", PickleName::bytes},
    {"pandas._libs.arrays __pyx_unpickle_NDArrayBacked", PickleName::other},
    {"pandas._libs.tslibs.timestamps _unpickle_timestamp", PickleName::other},
    {"pandas._libs.tslibs.timestamps Timestamp", PickleName::other},
    {"pandas._libs.tslibs.nattype _nat_unpickle", PickleName::other},
    {"pandas.core.arrays.datetimes DatetimeArray", PickleName::other},
    {"pandas.core.arrays.timedeltas TimedeltaArray", PickleName::other},
    {"pandas.core.arrays.categorical Categorical", PickleName::other},
    {"pandas.core.dtypes.dtypes CategoricalDtype", PickleName::other},
    {"pandas.core.dtypes.dtypes DatetimeTZDtype", PickleName::other},
    {"pandas.core.indexes.datetimes _new_DatetimeIndex", PickleName::other},
    {"pandas.core.indexes.datetimes DatetimeIndex", PickleName::other},
};

enum Opcode : std::uint8_t {
  op_mark = '(',
  op_stop = '.',
  op_pop = '0',
  op_pop_mark = '1',
  op_dup = '2',
  op_binfloat = 'G',
  op_binint = 'J',
  op_binint1 = 'K',
  op_binint2 = 'M',
  op_none = 'N',
  op_reduce = 'R',
  op_binunicode = 'X',
  op_append = 'a',
  op_build = 'b',
  op_global = 'c',
  op_appends = 'e',
  op_binget = 'h',
  op_long_binget = 'j',
  op_empty_list = ']',
  op_binput = 'q',
  op_long_binput = 'r',
  op_setitem = 's',
  op_tuple = 't',
  op_empty_tuple = ')',
  op_setitems = 'u',
  op_empty_dict = '}',
  op_proto = 0x80,
  op_newobj = 0x81,
  op_tuple1 = 0x85,
  op_tuple3 = 0x87,
  op_newtrue = 0x88,
  op_newfalse = 0x89,
  op_long1 = 0x8a,
  op_binbytes = 'B',
  op_short_binbytes = 'C',
  op_short_binunicode = 0x8c,
  op_binunicode8 = 0x8d,
  op_binbytes8 = 0x8e,
  op_stack_global = 0x93,
  op_memoize = 0x94,
  op_frame = 0x95,
  op_bytearray8 = 0x96,
};

using Kind = PickleValue::Kind;

const char* kind_name(Kind kind) {
  constexpr std::array names = {"None",   "a boolean", "an integer", "a number", "a string", "bytes",
                                "a list", "a tuple",   "a dict",     "a name",   "an object"};
  return names[static_cast<std::size_t>(kind)];
}

}  // namespace

class PickleMachine {
 public:
  PickleMachine(Pickle& out, std::span<const std::uint8_t> bytes)
      : out_(out), bytes_(bytes), reader_(bytes, out.file_) {}

  void run() {
    if (bytes_.size() > kMostOffset) fail(text("holds ", bytes_.size(), " bytes, the most is ", kMostOffset));
    require_protocol();
    for (std::uint8_t opcode = 0; opcode != op_stop;) {
      at_ = reader_.offset();
      opcode = reader_.little<std::uint8_t>("the pickle (no STOP came)");
      if (!number(opcode) && !words(opcode) && !container(opcode) && !memory(opcode) && !object(opcode)) {
        fail(text("opcode ", int(opcode), " is not allowed in a data frame (protocols 2 to 5)"));
      }
    }
    if (stack_.size() != 1 || !marks_.empty()) fail(text("the pickle ends with ", stack_.size(), " values, want 1"));
    if (reader_.remaining() > 0) fail(text(reader_.remaining(), " bytes follow the pickle's end"));
    out_.root_ = stack_.back();
  }

 private:
  [[noreturn]] void fail(const std::string& why) const {
    throw Error(Fault::data, text(out_.file_, ": byte ", at_, ": ", why, "; no code was executed"));
  }

  void require_protocol() {
    const bool sound = bytes_.size() >= 2 && bytes_[0] == op_proto && bytes_[1] >= 2 && bytes_[1] <= 5;
    if (!sound) fail("looked for a pickle of protocol 2 to 5, which begins with 128 and the protocol's number");
    reader_.skip(2, "the protocol");
  }

  PickleValue make(Kind kind, std::int64_t content = 0) const {
    PickleValue value;
    value.kind = kind;
    value.offset = static_cast<std::uint32_t>(at_);
    value.integer = content;
    return value;
  }

  // Each value costs a byte of the file, or more, but far more of memory.
  void push(const PickleValue& value) {
    if (++made_ > kMostValues) fail(text("more than ", kMostValues, " values, too many for a data frame"));
    stack_.push_back(value);
  }

  PickleValue pop() {
    if (stack_.size() <= (marks_.empty() ? 0 : marks_.back())) fail("takes a value from an empty stack");
    const PickleValue value = stack_.back();
    stack_.pop_back();
    return value;
  }

  PickleValue& top() {
    if (stack_.size() <= (marks_.empty() ? 0 : marks_.back())) fail("looks at a value of an empty stack");
    return stack_.back();
  }

  std::vector<PickleValue> pop_to_mark() {
    if (marks_.empty()) fail("no mark is set");
    std::vector<PickleValue> items(stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back()), stack_.end());
    stack_.resize(marks_.back());
    marks_.pop_back();
    return items;
  }

  std::vector<PickleValue> pop_items(int count) {
    std::vector<PickleValue> items(static_cast<std::size_t>(count));
    for (auto item = items.rbegin(); item != items.rend(); ++item) *item = pop();
    return items;
  }

  template <class Size>
  std::span<const std::uint8_t> sized(const char* what) {
    return reader_.take(reader_.little<Size>(what), what);
  }

  bool number(std::uint8_t opcode) {
    switch (opcode) {
      case op_none:
        push(make(Kind::none));
        return true;
      case op_newtrue:
      case op_newfalse:
        push(make(Kind::boolean, opcode == op_newtrue));
        return true;
      case op_binint:
        push(make(Kind::integer, reader_.little<std::int32_t>("a number")));
        return true;
      case op_binint1:
        push(make(Kind::integer, reader_.little<std::uint8_t>("a number")));
        return true;
      case op_binint2:
        push(make(Kind::integer, reader_.little<std::uint16_t>("a number")));
        return true;
      case op_long1:
        push(make(Kind::integer, long_integer(sized<std::uint8_t>("a number"))));
        return true;
      case op_binfloat: {
        PickleValue value = make(Kind::real);
        value.real = std::bit_cast<double>(reader_.big(8, "a number"));
        push(value);
        return true;
      }
      default:
        return false;
    }
  }

  // Two's complement, least byte first.
  std::int64_t long_integer(std::span<const std::uint8_t> digits) const {
    if (digits.size() > 8) fail(text("a whole number of ", digits.size(), " bytes, want at most 8"));
    std::uint64_t value = !digits.empty() && digits.back() >= 128 ? ~std::uint64_t{0} : 0;
    for (auto digit = digits.rbegin(); digit != digits.rend(); ++digit) value = value << 8 | *digit;
    return static_cast<std::int64_t>(value);
  }

  bool words(std::uint8_t opcode) {
    switch (opcode) {
      case op_short_binunicode:
        push_string(Kind::text, sized<std::uint8_t>("a text"));
        return true;
      case op_binunicode:
        push_string(Kind::text, sized<std::uint32_t>("a text"));
        return true;
      case op_binunicode8:
        push_string(Kind::text, sized<std::uint64_t>("a text"));
        return true;
      case op_short_binbytes:
        push_string(Kind::bytes, sized<std::uint8_t>("bytes"));
        return true;
      case op_binbytes:
        push_string(Kind::bytes, sized<std::uint32_t>("bytes"));
        return true;
      case op_binbytes8:
      case op_bytearray8:
        push_string(Kind::bytes, sized<std::uint64_t>("bytes"));
        return true;
      default:
        return false;
    }
  }

  void push_string(Kind kind, std::span<const std::uint8_t> content) {
    push(make(kind, static_cast<std::int64_t>(out_.strings_.size())));
    out_.strings_.push_back(content);
  }

  bool container(std::uint8_t opcode) {
    switch (opcode) {
      case op_mark:
        if (marks_.size() == kMostMarks) fail(text("nested deeper than ", kMostMarks));
        marks_.push_back(stack_.size());
        return true;
      case op_empty_list:
        push_list(Kind::list, {});
        return true;
      case op_empty_dict:
        push_list(Kind::dict, {});
        return true;
      case op_empty_tuple:
        push_list(Kind::tuple, {});
        return true;
      case op_tuple:
        push_list(Kind::tuple, pop_to_mark());
        return true;
      case op_append:
        extend(Kind::list, pop_items(1));
        return true;
      case op_appends:
        extend(Kind::list, pop_to_mark());
        return true;
      case op_setitem:
        extend(Kind::dict, pop_items(2));
        return true;
      case op_setitems:
        extend(Kind::dict, pop_to_mark());
        return true;
      default:
        break;
    }
    if (opcode < op_tuple1 || opcode > op_tuple3) return false;
    push_list(Kind::tuple, pop_items(opcode - op_tuple1 + 1));
    return true;
  }

  void push_list(Kind kind, std::vector<PickleValue> items) {
    push(make(kind, static_cast<std::int64_t>(out_.lists_.size())));
    out_.lists_.push_back(std::move(items));
  }

  void extend(Kind kind, const std::vector<PickleValue>& items) {
    const PickleValue target = top();
    if (target.kind != kind) fail(text("needs ", kind_name(kind), " to add to, found ", kind_name(target.kind)));
    if (kind == Kind::dict && items.size() % 2 != 0) fail("a key without a value");
    auto& list = out_.lists_[static_cast<std::size_t>(target.integer)];
    list.insert(list.end(), items.begin(), items.end());
  }

  // The stack and the memo.
  bool memory(std::uint8_t opcode) {
    switch (opcode) {
      case op_stop:
        return true;
      case op_frame:
        check_frame(reader_.little<std::uint64_t>("a frame"));
        return true;
      case op_pop:
        pop();
        return true;
      case op_pop_mark:
        pop_to_mark();
        return true;
      case op_dup:
        push(top());
        return true;
      case op_memoize:
        put(memo_.size());
        return true;
      case op_binput:
        put(reader_.little<std::uint8_t>("a memo's number"));
        return true;
      case op_long_binput:
        put(reader_.little<std::uint32_t>("a memo's number"));
        return true;
      case op_binget:
        get(reader_.little<std::uint8_t>("a memo's number"));
        return true;
      case op_long_binget:
        get(reader_.little<std::uint32_t>("a memo's number"));
        return true;
      default:
        return false;
    }
  }

  void check_frame(std::uint64_t length) const {
    if (length > reader_.remaining()) {
      fail(text("a frame of ", length, " bytes, ", reader_.remaining(), " are left; the file is truncated"));
    }
  }

  void put(std::uint64_t number) {
    if (memo_.size() >= kMostValues) fail("too many memos");
    memo_[number] = top();
  }

  void get(std::uint64_t number) {
    const auto found = memo_.find(number);
    if (found == memo_.end()) fail(text("memo ", number, " was never set"));
    push(found->second);
  }

  bool object(std::uint8_t opcode) {
    switch (opcode) {
      case op_global: {
        const std::string module = line(), name = line();
        push_name(module + " " + name);
        return true;
      }
      case op_stack_global: {
        const PickleValue name = pop(), module = pop();
        push_name(std::string(out_.text(module, "a module's name")) + " " +
                  std::string(out_.text(name, "a function's name")));
        return true;
      }
      case op_reduce:
      case op_newobj:
        record();
        return true;
      case op_build:
        build();
        return true;
      default:
        return false;
    }
  }

  std::string line() {
    constexpr int kLongest = 256;
    std::string result;
    for (char c = 0; (c = static_cast<char>(reader_.little<std::uint8_t>("a name"))) != '\n';) {
      if (result.size() == kLongest) fail(text("a name of more than ", kLongest, " bytes"));
      result += c;
    }
    return result;
  }

  void push_name(const std::string& spelling) {
    const auto found = std::find_if(std::begin(kAllowed), std::end(kAllowed),
                                    [&](const AllowedName& allowed) { return allowed.spelling == spelling; });
    if (found == std::end(kAllowed)) {
      fail(text("the pickle asks for \"", printable(spelling), "\"; only pandas data frames of numpy arrays are ",
                "read"));
    }
    push(make(Kind::name, static_cast<std::int64_t>(found->name)));
  }

  void record() {
    const PickleValue arguments = pop(), callee = pop();
    if (callee.kind != Kind::name) fail(text("needs a name to build from, found ", kind_name(callee.kind)));
    if (arguments.kind != Kind::tuple) fail(text("needs a tuple of arguments, found ", kind_name(arguments.kind)));
    const auto name = static_cast<PickleName>(callee.integer);
    const auto items = out_.list(arguments, "arguments");
    if (name == PickleName::encode || name == PickleName::bytes) return push_encoded(items);
    PickleRecord made;
    made.name = name;
    made.arguments.assign(items.begin(), items.end());
    if ((copied_ += items.size()) > kMostValues) fail("too many arguments");
    push(make(Kind::record, static_cast<std::int64_t>(out_.records_.size())));
    out_.records_.push_back(std::move(made));
  }

  // Before protocol 3, bytes are written as a text whose code points are the bytes.
  void push_encoded(std::span<const PickleValue> arguments) {
    if (arguments.empty()) return push_string(Kind::bytes, {});
    if (arguments.size() == 1) return push_string(Kind::bytes, out_.bytes(arguments[0], "bytes"));
    const auto coding = out_.text(arguments[1], "the name of an encoding");
    if (coding != "latin1" && coding != "latin-1") fail("bytes in an encoding other than latin1");
    const std::string_view content = out_.text(arguments[0], "bytes as a string");
    // A text that is encoded again and again would fill the memory from a small file.
    if ((decoded_ += content.size()) > bytes_.size()) fail("more bytes are unpacked than the file holds");
    out_.owned_.push_back(latin1(content));
    push_string(Kind::bytes, out_.owned_.back());
  }

  std::vector<std::uint8_t> latin1(std::string_view utf8) const {
    std::vector<std::uint8_t> result;
    result.reserve(utf8.size());
    for (std::size_t i = 0; i < utf8.size(); ++i) {
      const auto lead = static_cast<std::uint8_t>(utf8[i]);
      if (lead < 0x80) {
        result.push_back(lead);
        continue;
      }
      const bool pair = (lead == 0xc2 || lead == 0xc3) && i + 1 < utf8.size() && (utf8[i + 1] & 0xc0) == 0x80;
      if (!pair) fail("bytes stored as a string that is not latin1");
      result.push_back(static_cast<std::uint8_t>((lead & 3) << 6 | (utf8[++i] & 0x3f)));
    }
    return result;
  }

  void build() {
    const PickleValue state = pop(), target = top();
    if (target.kind != Kind::record) fail(text("needs an object to set the state of, found ", kind_name(target.kind)));
    PickleRecord& object = out_.records_[static_cast<std::size_t>(target.integer)];
    if (object.has_state) fail("sets the state of an object twice");
    object.state = state;
    object.has_state = true;
  }

  Pickle& out_;
  std::span<const std::uint8_t> bytes_;
  ByteReader reader_;
  std::size_t at_ = 0;  // of the opcode
  std::vector<PickleValue> stack_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint64_t, PickleValue> memo_;
  std::size_t made_ = 0, copied_ = 0, decoded_ = 0;
};

Pickle::Pickle(std::span<const std::uint8_t> bytes, std::string name) : file_(std::move(name)) {
  PickleMachine(*this, bytes).run();
}

void Pickle::unlike(const PickleValue& value, const std::string& wanted) const {
  throw Error(Fault::data,
              cloam::text(file_, ": byte ", value.offset, ": looked for ", wanted, ", found ", kind_name(value.kind)));
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

bool Pickle::is(const PickleValue& value, PickleName name) const {
  return value.kind == Kind::record && records_[static_cast<std::size_t>(value.integer)].name == name;
}

const PickleValue* Pickle::find(const PickleValue& dict, std::string_view key, const char* what) const {
  if (dict.kind != Kind::dict) unlike(dict, what);
  const auto& items = lists_[static_cast<std::size_t>(dict.integer)];
  const PickleValue* found = nullptr;  // the last of equal keys counts, as in Python
  for (std::size_t i = 0; i + 1 < items.size(); i += 2) {
    if (items[i].kind == Kind::text && text(items[i], "a key") == key) found = &items[i + 1];
  }
  return found;
}

}  // namespace cloam
