// See json.h.
#include "models/io/json.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "models/io/bytes.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{256} << 20;
constexpr std::uint64_t kMaxParsed = std::uint64_t{512} << 20;
constexpr std::uint64_t kListed = 24, kKeyed = 112, kContainer = 56;  // bytes that values take, about
constexpr std::size_t kDeepest = 64;
constexpr int kOutOfRange = 406;  // the library's number of the error
constexpr std::size_t kLongestReason = 300;

[[noreturn]] void wrong(const std::string& where, const std::string& key, const std::string& wanted,
                        const Json& found) {
  bad_data(where, ": ", key, " is ", found.type_name(), ", want ", wanted,
           found.is_null() ? " (NaN and Infinity are not numbers); correct or remove it" : "");
}

// Where the string that begins at `start` ends, behind its quote.
std::size_t end_of_string(std::string_view content, std::size_t start) {
  std::size_t i = start + 1;
  while (i < content.size() && content[i] != '"') i += content[i] == '\\' ? 2 : 1;
  return std::min(i + 1, content.size());
}

// Python's words for numbers that JSON has not, outside quotes, become null; line numbers stay as they are.
std::string without_python_words(std::string_view content) {
  std::string result;
  result.reserve(content.size());
  for (std::size_t i = 0; i < content.size();) {
    const std::string_view rest = content.substr(i);
    if (rest.front() == '"') {
      const std::size_t end = end_of_string(content, i);
      result += content.substr(i, end - i);
      i = end;
    } else if (rest.starts_with("NaN") || rest.starts_with("Infinity")) {
      const bool infinite = rest.front() == 'I';
      if (infinite && !result.empty() && result.back() == '-') result.pop_back();
      result += "null";
      i += infinite ? 8 : 3;
    } else {
      result += rest.front();
      ++i;
    }
  }
  return result;
}

std::string place(std::string_view content, std::size_t offset) {
  offset = std::min(offset, content.size());
  const std::string_view before = content.substr(0, offset);
  const std::size_t start = before.rfind('\n');  // npos + 1 is 0
  return text("line ", std::count(before.begin(), before.end(), '\n') + 1, ", column ", offset - start);
}

// Builds the values and refuses what the library would accept: deep nesting, keys given twice (which of the two
// counts?), and more values than memory should hold. In one pass, each value touched once: the library's own parser
// with a callback looks at all earlier values of a list whenever an object in it ends.
class Builder : public nlohmann::json_sax<Json> {
 public:
  using Use = std::function<void(const Json& value, std::size_t number)>;
  Builder(std::string_view content, const std::string& name, Json& root)
      : content_(content), name_(name), root_(root) {}
  /// Of a list that is not kept: each of its values goes to `use`.
  Builder(const std::string& name, Json& root, Use use) : name_(name), root_(root), use_(std::move(use)) {}

  bool null() override { return add(nullptr); }
  bool boolean(bool value) override { return add(value); }
  bool number_integer(number_integer_t value) override { return add(value); }
  bool number_unsigned(number_unsigned_t value) override { return add(value); }
  bool number_float(number_float_t value, const string_t&) override { return add(value); }
  bool string(string_t& value) override { return add(std::move(value)); }
  bool binary(binary_t&) override { return false; }
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }

  bool key(string_t& value) override {
    if (open_.back()->contains(value)) fail(text("the key \"", printable(value), "\" appears twice in one object"));
    key_ = std::move(value);
    return true;
  }

  bool parse_error(std::size_t position, const std::string& token, const nlohmann::detail::exception& error) override {
    // Says "[json.exception.parse_error.101] parse error at line 3, column 5: ..."; that a number is too large has no
    // place.
    const std::string said = error.what();
    const std::size_t after = said.find("] ");
    const std::string reason = said.substr(after == said.npos ? 0 : after + 2, kLongestReason);
    if (error.id == kOutOfRange) fail(text(place(content_, position - token.size()), ": ", reason));
    fail("not valid JSON: " + reason + "\n  fix: correct it there, or copy or export the file again");
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { bad_data(name_, ": ", why); }

  bool add(Json value) {
    place_for(std::move(value));
    return pass_on();
  }

  bool open(Json container) {
    if (open_.size() == kDeepest) fail(text("nested deeper than ", kDeepest));
    open_.push_back(&place_for(std::move(container)));
    return true;
  }

  bool close() {
    open_.pop_back();
    return pass_on();
  }

  /// A value of the outermost list that is complete, if that list is not kept.
  bool pass_on() {
    if (!use_ || open_.size() > 1) return true;
    auto* list = root_.get_ptr<Json::array_t*>();
    if (!list) fail(text("want a list, found ", root_.type_name()));
    if (list->empty()) return true;  // the list itself ends
    use_(list->back(), used_++);
    list->clear();
    bytes_ = 0;
    return true;
  }

  // What lies above in open_ stays where it is: nothing is added to a container while one in it is open.
  Json& place_for(Json value) {
    const auto* words = value.get_ptr<const std::string*>();
    const bool listed = open_.empty() || open_.back()->is_array();
    bytes_ += (listed ? kListed : kKeyed + key_.size()) + (value.is_structured() ? kContainer : 0);
    bytes_ += words ? words->size() : 0;
    if (bytes_ > kMaxParsed)
      fail(text("too many values: they would take more than ", kMaxParsed >> 20, " MB of memory"));
    if (open_.empty()) return root_ = std::move(value);
    if (auto* list = open_.back()->get_ptr<Json::array_t*>()) return list->emplace_back(std::move(value));
    auto& object = open_.back()->get_ref<Json::object_t&>();
    return object.emplace(std::exchange(key_, {}), std::move(value)).first->second;
  }

  std::string_view content_;
  const std::string& name_;
  Json& root_;
  std::vector<Json*> open_;  // containers that are not closed yet, the innermost last
  std::string key_;
  std::uint64_t bytes_ = 0;
  Use use_;               // empty: all is kept
  std::size_t used_ = 0;  // values of the outermost list
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
  const auto bytes = read_file(path, kMaxJsonBytes);
  const std::string_view content(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return without_quotes(path, [&] { return parse_json(content, path.string()); });
}

Json parse_json(std::string_view given, const std::string& name) {
  const bool pythonic = given.find("NaN") != given.npos || given.find("Infinity") != given.npos;
  const std::string changed = pythonic ? without_python_words(given) : "";
  const std::string_view content = pythonic ? changed : given;
  Json root;
  Builder builder(content, name, root);
  Json::sax_parse(content.begin(), content.end(), &builder);
  return root;
}

void for_each_in_json_file(const std::filesystem::path& path, const Builder::Use& use) {
  std::ifstream file(path, std::ios::binary);
  if (!file) bad_data(path.string(), ": cannot be opened");
  without_quotes(path, [&] {
    const std::string name = path.string();
    Json root;
    Builder builder(name, root, use);
    Json::sax_parse(file, &builder);
  });
}

const Json& member(const Json& object, const std::string& key, const std::string& where) {
  if (!object.is_object()) wrong(where, "the value around " + key, "an object", object);
  const auto found = object.find(key);
  if (found == object.end()) bad_data(where, ": the key ", key, " is missing");
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
  if (rows.size() != 4 && rows.size() != 3)
    bad_data(where, ": ", key, " has ", rows.size(), " rows, want 4 (or 3) rows of 4 numbers");
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const std::string row = text(key, "[", r, "]");
    if (!rows[r].is_array() || rows[r].size() != 4) wrong(where, row, "4 numbers", rows[r]);
    for (std::size_t c = 0; c < 4; ++c) matrix(r, c) = finite(rows[r][c], text(row, "[", c, "]"), where);
  }
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-6)
    bad_data(where, ": the last row of ", key, " is not 0 0 0 1");
  return matrix;
}

}  // namespace cloam
