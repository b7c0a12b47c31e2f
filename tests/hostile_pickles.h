// Pickles that try to run something, to fill the memory, or that are no sound data frame. None may do anything but give
// an Error (Fault::data). Those that run a command would leave the file `canary`.
#pragma once
#include <bit>
#include <cstdint>
#include <string>
#include <vector>

namespace cloam {

struct HostilePickle {
  std::string name, bytes;
};

namespace hostile {

inline std::string little(std::uint64_t value, int bytes) {
  std::string result;
  for (int i = 0; i < bytes; ++i) result += static_cast<char>(value >> 8 * i);
  return result;
}

inline std::string text(const std::string& content) { return "X" + little(content.size(), 4) + content; }
inline std::string name(const std::string& module, const std::string& function) {
  return "c" + module + "\n" + function + "\n";
}
inline std::string stack_name(const std::string& module, const std::string& function) {
  return text(module) + text(function) + "\x93";
}
inline std::string whole(std::int64_t value) { return std::string("\x8a\x08") + little(std::uint64_t(value), 8); }
inline std::string repeated(const std::string& part, std::size_t count) {
  std::string result;
  for (std::size_t i = 0; i < count; ++i) result += part;
  return result;
}

inline std::string type(const std::string& word, const std::string& order = "<") {
  return name("numpy", "dtype") + text(word) + "\x89\x88\x87R(K\x03" + text(order) + "NNNJ" + little(~0u, 4) + "J" +
         little(~0u, 4) + "K" + std::string(1, '\0') + "tb";
}

/// shape: opcodes that leave a tuple; content: opcodes that leave bytes or a list.
inline std::string array(const std::string& shape, const std::string& dtype, const std::string& content,
                         const std::string& order = "\x89") {
  return name("numpy.core.multiarray", "_reconstruct") + name("numpy", "ndarray") + "K" + std::string(1, '\0') +
         "\x85" + "C\x01" + "b\x87R(K\x01" + shape + dtype + order + content + "tb";
}

inline std::string raw(const std::string& content) { return "B" + little(content.size(), 4) + content; }
inline std::string shape(std::int64_t rows) { return whole(rows) + "\x85"; }
inline std::string shape(std::int64_t columns, std::int64_t rows) { return whole(columns) + whole(rows) + "\x86"; }

inline std::string index(const std::string& data) {
  return name("pandas.core.indexes.base", "_new_Index") + name("pandas.core.indexes.base", "Index") + "}(" +
         text("data") + data + text("name") + "Nu\x86R";
}
inline std::string names(const std::vector<std::string>& words) {
  std::string list = "](";
  for (const std::string& word : words) list += text(word);
  return index(array(shape(std::int64_t(words.size())), type("O8", "|"), list + "e"));
}
inline std::string slice(std::int64_t start, std::int64_t stop, std::int64_t step) {
  return name("builtins", "slice") + whole(start) + whole(stop) + whole(step) + "\x87R";
}
inline std::string block(const std::string& values, const std::string& places) {
  return name("pandas._libs.internals", "_unpickle_block") + values + places + "K\x02\x87R";
}
/// blocks: opcodes of all blocks, one after the other.
inline std::string frame(const std::string& blocks, const std::string& axes) {
  return std::string("\x80\x02") + name("pandas.core.frame", "DataFrame") + ")\x81}(" + text("_mgr") +
         name("pandas.core.internals.managers", "BlockManager") + "(" + blocks + "t](" + axes + "e\x86Rub.";
}
inline std::string two_axes(const std::vector<std::string>& words) { return names(words) + names({"row"}); }

/// One column x with the number 0: sound, the stem of what is broken below.
inline std::string values() { return array(shape(1, 1), type("f8"), raw(std::string(8, '\0'))); }
inline std::string sound() { return frame(block(values(), slice(0, 1, 1)), two_axes({"x"})); }
inline std::string with_values(const std::string& values) {
  return frame(block(values, slice(0, 1, 1)), two_axes({"x"}));
}
inline std::string with_places(const std::string& places) { return frame(block(values(), places), two_axes({"x"})); }

/// A call in protocol 2; `before` are opcodes that run before the name.
inline std::string call(const std::string& module, const std::string& function, const std::string& argument) {
  return "\x80\x02" + name(module, function) + text(argument) + "\x85R.";
}

}  // namespace hostile

inline std::vector<HostilePickle> hostile_pickles(const std::string& canary) {
  using namespace hostile;
  const std::string touch = "touch " + canary, code = "open(" + std::string("'") + canary + "','w')";
  const std::string zero(8, '\0');
  return {
      // Calls, by every road.
      {"os.system", call("os", "system", touch)},
      {"posix.system", call("posix", "system", touch)},
      {"builtins.eval", call("builtins", "eval", code)},
      {"builtins.exec", call("__builtin__", "exec", code)},
      {"builtins.__import__", call("builtins", "__import__", "os")},
      {"builtins.open", call("builtins", "open", canary)},
      {"builtins.getattr", call("builtins", "getattr", "os")},
      {"subprocess.Popen", call("subprocess", "Popen", touch)},
      {"importlib.import_module", call("importlib", "import_module", "os")},
      {"operator.attrgetter", call("operator", "attrgetter", "system")},
      {"pkgutil.resolve_name", call("pkgutil", "resolve_name", "os:system")},
      {"runpy.run_path", call("runpy", "run_path", canary)},
      {"pickle.loads", call("pickle", "loads", touch)},
      {"numpy.load", call("numpy", "load", canary)},
      {"numpy testing", call("numpy.testing._private.utils", "runstring", code)},
      {"pandas.read_pickle", call("pandas", "read_pickle", canary)},
      {"pandas eval", call("pandas.core.computation.eval", "eval", code)},
      {"a name with a dot", "\x80\x04" + stack_name("numpy", "ndarray.__class__") + text(touch) + "\x85R."},
      {"stack name", "\x80\x04" + stack_name("os", "system") + text(touch) + "\x85R."},
      {"stack name from the memo", std::string("\x80\x04") + text("os") + "\x94" + text("system") + "\x94" + "0" +
                                       "0h" + little(0, 1) + "h\x01\x93" + text(touch) + "\x85R."},
      {"new object", "\x80\x02" + name("os", "system") + text(touch) + "\x85\x81."},
      {"new object with keywords", "\x80\x04" + stack_name("os", "system") + text(touch) + "\x85}\x92."},
      {"INST", "\x80\x02(" + text(touch) + "ios\nsystem\n."},
      {"OBJ", "\x80\x02(" + name("os", "system") + text(touch) + "o."},
      {"extension registry", std::string("\x80\x02\x82\x01.")},
      {"persistent name", "\x80\x02" + text(touch) + "Q."},
      {"persistent name as a line", "\x80\x02P" + touch + "\n."},
      {"a call on a list", "\x80\x02]" + text(touch) + "\x85R."},
      {"a call on a text", "\x80\x02" + text("os.system") + text(touch) + "\x85R."},
      {"call within a frame", with_values("\x80" + std::string("\x02") + name("os", "system") + text(touch) + "\x85R")},
      {"call as a column's name",
       frame(block(values(), slice(0, 1, 1)), index(name("os", "system") + text(touch) + "\x85R") + names({"row"}))},
      {"state of a function", "\x80\x02" + name("numpy", "ndarray") + "}" + text("__reduce__") + text(touch) + "sb."},
      {"state with a call after the end", sound() + call("os", "system", touch)},
      // Protocols and streams.
      {"empty", ""},
      {"protocol 0", "cos\nsystem\n(S'" + touch + "'\ntR."},
      {"protocol 6", "\x80\x06N."},
      {"no end", std::string("\x80\x02N")},
      {"two values at the end", std::string("\x80\x02NN.")},
      {"unknown opcode", std::string("\x80\x02\xff.")},
      {"out-of-band buffer", std::string("\x80\x05\x97.")},
      {"stack underflow", std::string("\x80\x02\x87.")},
      {"pop below a mark", std::string("\x80\x02N(0.")},
      {"no mark", std::string("\x80\x02t.")},
      {"memo never set", std::string("\x80\x02h\x07.")},
      {"frame beyond the end", "\x80\x04\x95" + little(~std::uint64_t{0}, 8) + "N."},
      // Sizes and depths.
      {"text of 4 GB", "\x80\x02X" + little(0xfffffff0, 4) + "x."},
      {"text of 2^63", "\x80\x04\x8d" + little(std::uint64_t{1} << 63, 8) + "x."},
      {"bytes of 2^64 - 1", "\x80\x04\x8e" + little(~std::uint64_t{0}, 8) + "x."},
      {"whole number of 255 bytes", "\x80\x02\x8a\xff" + std::string(255, '\x7f') + "."},
      {"a million marks", "\x80\x02" + std::string(1'000'000, '(') + "."},
      {"lists nested a million deep", "\x80\x02" + std::string(1'000'000, ']') + std::string(999'999, 'a') + "."},
      {"a list in itself", "\x80\x02]q" + little(0, 1) + "h" + little(0, 1) + "a."},
      {"two million values", "\x80\x02(" + std::string(2'000'000, 'N') + "t."},
      {"two million tuples", "\x80\x02(" + std::string(2'000'000, ')') + "t."},
      {"billion laughs", "\x80\x02](NNNNNNNNNNe" +
                             repeated("q" + little(0, 1) + "0](" + repeated("h" + little(0, 1), 10) + "e", 40) + "."},
      {"bytes decoded again and again", "\x80\x02(" + name("_codecs", "encode") + "q\x01" +
                                            text(std::string(1000, 'x')) + text("latin1") + "\x86q\x02R" +
                                            repeated("h\x01h\x02R", 1000) + "t."},
      {"memo number 2^32 - 1", "\x80\x02Nr" + little(~0u, 4) + "j" + little(~0u - 1, 4) + "."},
      // Arrays and blocks that lie.
      {"array of 2^62 rows", with_values(array(shape(1, std::int64_t{1} << 62), type("f8"), raw(zero)))},
      {"array whose size overflows",
       with_values(array(shape(std::int64_t{1} << 32, std::int64_t{1} << 32), type("f8"), raw("")))},
      {"array of -1 rows", with_values(array(shape(1, -1), type("f8"), raw(zero)))},
      {"array with too few bytes", with_values(array(shape(1, 2), type("f8"), raw(zero)))},
      {"array with too many bytes", with_values(array(shape(1, 1), type("f8"), raw(zero + zero)))},
      {"array of three axes", with_values(array(whole(1) + whole(1) + whole(1) + "\x87", type("f8"), raw(zero)))},
      {"array without an axis", with_values(array(")", type("f8"), raw(zero)))},
      {"objects as numbers", with_values(array(shape(1, 1), type("O8", "|"), raw(zero)))},
      {"numbers as objects", with_values(array(shape(1, 1), type("f8"), "](Ne"))},
      {"objects from a buffer", with_values(name("numpy.core.numeric", "_frombuffer") + "(" + raw(zero) +
                                            type("O8", "|") + shape(1, 1) + text("C") + "tR")},
      {"array without a state", with_values(name("numpy.core.multiarray", "_reconstruct") + name("numpy", "ndarray") +
                                            "K" + std::string(1, '\0') + "\x85" + "C\x01" + "b\x87R")},
      {"array that is its own state",
       with_values(name("numpy.core.multiarray", "_reconstruct") + ")Rq\x09h\x09" + "b")},
      {"slice of 2^60 columns", with_places(slice(0, std::int64_t{1} << 60, 1))},
      {"slice with step 0", with_places(slice(0, 1, 0))},
      {"slice that runs back", with_places(slice(0, 1, -1))},
      {"block for column 7", with_places(slice(7, 8, 1))},
      {"two blocks for a column",
       frame(block(values(), slice(0, 1, 1)) + block(values(), slice(0, 1, 1)), two_axes({"x"}))},
      {"no block for a column", frame(block(values(), slice(0, 1, 1)), two_axes({"x", "y"}))},
      {"blocks of different length",
       frame(block(values(), slice(0, 1, 1)) + block(array(shape(1, 2), type("f8"), raw(zero + zero)), slice(1, 2, 1)),
             two_axes({"x", "y"}))},
      {"two columns of a name",
       frame(block(array(shape(2, 1), type("f8"), raw(zero + zero)), slice(0, 2, 1)), two_axes({"x", "x"}))},
      {"one axis", frame(block(values(), slice(0, 1, 1)), names({"x"}))},
      {"a dict of numbers for a frame", std::string("\x80\x02}K\x01K\x02s.")},
      {"a name for a frame", "\x80\x02" + name("pandas.core.frame", "DataFrame") + "."},
      {"a frame without a state", "\x80\x02" + name("pandas.core.frame", "DataFrame") + ")\x81."},
  };
}

}  // namespace cloam
