// See json.h.
#include "models/data/json.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>

#include "models/io/bytes.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;
constexpr int kDeepest = 64;

[[noreturn]] void wrong(const std::string& where, const std::string& key, const std::string& wanted,
                        const Json& found) {
  throw Error(Fault::data, text(where, ": ", key, " is ", found.type_name(), ", want ", wanted,
                                found.is_null() ? " (NaN and Infinity are not numbers)" : ""));
}

// Python's words for numbers that JSON has not, outside quotes, become null; line numbers stay as they are.
std::string without_python_words(const std::string& content) {
  std::string result;
  result.reserve(content.size());
  bool quoted = false;
  for (std::size_t i = 0; i < content.size(); ++i) {
    const bool not_a_number = !quoted && content.compare(i, 3, "NaN") == 0;
    const bool infinite = !quoted && content.compare(i, 8, "Infinity") == 0;
    if (not_a_number || infinite) {
      if (infinite && !result.empty() && result.back() == '-') result.pop_back();
      result += "null";
      i += not_a_number ? 2 : 7;
      continue;
    }
    result += content[i];
    if (content[i] == '"') quoted = !quoted;
    if (quoted && content[i] == '\\' && i + 1 < content.size()) result += content[++i];
  }
  return result;
}

std::string place(const std::string& content, std::size_t offset) {
  const auto end = content.begin() + static_cast<std::ptrdiff_t>(std::min(offset, content.size()));
  const auto line = std::count(content.begin(), end, '\n') + 1;
  const auto start = content.rfind('\n', offset == 0 ? 0 : offset - 1);
  return text("line ", line, ", column ", start == std::string::npos || start >= offset ? offset + 1 : offset - start);
}

// "[json.exception.parse_error.101] parse error at line 3, column 5: ..." without the library's own number.
std::string reason(const nlohmann::json::exception& error) {
  const char* after = std::strstr(error.what(), "] ");
  return after ? after + 2 : error.what();
}

// Refuses what the parser would accept: deep nesting and keys given twice (which of the two counts?).
class Strictness {
 public:
  explicit Strictness(std::string name) : name_(std::move(name)) {}

  bool operator()(int depth, Json::parse_event_t event, const Json& parsed) {
    using Event = Json::parse_event_t;
    if (depth > kDeepest) throw Error(Fault::data, text(name_, ": nested deeper than ", kDeepest));
    if (event == Event::object_start) keys_.emplace_back();
    if (event == Event::object_end) keys_.pop_back();
    if (event == Event::key && !keys_.back().insert(parsed.get_ref<const std::string&>()).second) {
      throw Error(Fault::data, text(name_, ": the key ", parsed.dump(), " stands twice in one object"));
    }
    return true;
  }

 private:
  std::string name_;
  std::vector<std::set<std::string>> keys_;
};

double finite(const Json& value, const std::string& key, const std::string& where) {
  const auto* found = value.is_number_float() ? value.get_ptr<const double*>() : nullptr;
  if (!value.is_number()) wrong(where, key, "a finite number", value);
  const double result = found ? *found : value.get<double>();
  if (!std::isfinite(result)) wrong(where, key, "a finite number", value);
  return result;
}

}  // namespace

Json parse_json_file(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMostBytes);
  return parse_json(std::string(bytes.begin(), bytes.end()), path.string());
}

Json parse_json(const std::string& given, const std::string& name) {
  const std::string content = without_python_words(given);
  try {
    Strictness strictness(name);
    return Json::parse(content, std::ref(strictness));
  } catch (const nlohmann::json::out_of_range& error) {
    // The one such error in parsing is a number too large for double; it carries no place but quotes the number.
    const std::string message = reason(error);
    const auto first = message.find('\''), last = message.rfind('\'');
    const std::string quoted = last > first ? message.substr(first + 1, last - first - 1) : "";
    throw Error(Fault::data, text(name, ": ", place(content, content.find(quoted)), ": ", message));
  } catch (const nlohmann::json::exception& error) {
    throw Error(Fault::data, text(name, ": not valid JSON: ", reason(error)));
  }
}

const Json& member(const Json& object, const std::string& key, const std::string& where) {
  if (!object.is_object()) wrong(where, "the value around " + key, "an object", object);
  const auto found = object.find(key);
  if (found == object.end()) throw Error(Fault::data, text(where, ": the key ", key, " is missing"));
  return *found;
}

double number(const Json& object, const std::string& key, const std::string& where) {
  return finite(member(object, key, where), key, where);
}

std::string string(const Json& object, const std::string& key, const std::string& where) {
  const Json& value = member(object, key, where);
  const auto* found = value.get_ptr<const std::string*>();
  if (!found) wrong(where, key, "a string", value);
  return *found;
}

const Json& array(const Json& object, const std::string& key, const std::string& where) {
  const Json& value = member(object, key, where);
  if (!value.is_array()) wrong(where, key, "an array", value);
  return value;
}

std::optional<double> optional_number(const Json& object, const std::string& key, const std::string& where) {
  if (!object.contains(key)) return {};
  return number(object, key, where);
}

std::optional<std::string> optional_string(const Json& object, const std::string& key, const std::string& where) {
  if (!object.contains(key) || object.at(key).is_null()) return {};
  return string(object, key, where);
}

bool flag(const Json& object, const std::string& key, bool otherwise, const std::string& where) {
  if (!object.contains(key)) return otherwise;
  const Json& value = object.at(key);
  const auto* found = value.get_ptr<const bool*>();
  if (!found) wrong(where, key, "true or false", value);
  return *found;
}

Eigen::Matrix4d matrix4(const Json& object, const std::string& key, const std::string& where) {
  const Json& rows = array(object, key, where);
  if (rows.size() != 4 && rows.size() != 3) {
    throw Error(Fault::data, text(where, ": ", key, " has ", rows.size(), " rows, want 4 (or 3) rows of 4 numbers"));
  }
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const std::string row = text(key, "[", r, "]");
    if (!rows[r].is_array() || rows[r].size() != 4) wrong(where, row, "4 numbers", rows[r]);
    for (std::size_t c = 0; c < 4; ++c) matrix(r, c) = finite(rows[r][c], text(row, "[", c, "]"), where);
  }
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-6) {
    throw Error(Fault::data, text(where, ": the last row of ", key, " is not 0 0 0 1"));
  }
  return matrix;
}

}  // namespace cloam
