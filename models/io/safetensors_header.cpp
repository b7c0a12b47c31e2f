// What json.h refuses, deep nesting, keys given twice and more values than memory should hold, needs no check here.
#include "models/io/safetensors_header.h"

#include <limits>
#include <nlohmann/json.hpp>

#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr size_t kMaxStoredRank = 16;
constexpr char kMetadata[] = "__metadata__";

/// What an error says was found.
std::string described(const Json& value) {
  if (value.is_number()) return text(value < 0 ? "the negative number " : "the number ", printable(value.dump()));
  if (value.is_null()) return "null";
  const bool vowel = value.is_object() || value.is_array();
  return text(vowel ? "an " : "a ", value.type_name());
}

/// One tensor, or the metadata.
class HeaderItem {
 public:
  HeaderItem(const std::string& name, const Json& fields) : name_(name), fields_(fields) {
    if (!fields.is_object()) refuse(described(fields), "");
  }

  std::map<std::string, std::string> metadata() const {
    std::map<std::string, std::string> all;
    for (const auto& [key, value] : fields_.items()) all[key] = word(key, value);
    return all;
  }

  SafetensorsEntry entry() const {
    for (const auto& [key, value] : fields_.items()) {
      if (key != "dtype" && key != "shape" && key != "data_offsets") refuse("an unknown key", key);
    }
    SafetensorsEntry entry;
    entry.dtype = word("dtype", field("dtype"));
    for (const uint64_t extent : numbers("shape")) {
      if (extent > uint64_t{std::numeric_limits<int64_t>::max()}) refuse(text("the size ", extent), "shape");
      entry.shape.push_back(static_cast<int64_t>(extent));
    }
    const std::vector<uint64_t> offsets = numbers("data_offsets");
    if (offsets.size() != 2) refuse(text(offsets.size(), " numbers, need 2"), "data_offsets");
    entry.begin = offsets[0];
    entry.end = offsets[1];
    return entry;
  }

 private:
  [[noreturn]] void refuse(const std::string& found, const std::string& key) const {
    bad_data("header of tensor '", printable(name_), "': found ", found, " at key '", printable(key),
             "', want {\"dtype\":string, \"shape\":[sizes], \"data_offsets\":[begin,end]}");
  }

  const Json& field(const std::string& key) const {
    const auto found = fields_.find(key);
    if (found == fields_.end()) refuse("no " + key, key);
    return *found;
  }

  std::string word(const std::string& key, const Json& value) const {
    if (!value.is_string()) refuse(described(value), key);
    return value.get<std::string>();
  }

  std::vector<uint64_t> numbers(const std::string& key) const {
    const Json& list = field(key);
    if (!list.is_array()) refuse(described(list), key);
    if (list.size() > kMaxStoredRank) refuse(text("more than ", kMaxStoredRank, " numbers"), key);
    for (const Json& value : list) {
      if (!value.is_number_unsigned()) refuse(described(value), key);
    }
    return list.get<std::vector<uint64_t>>();
  }

  const std::string& name_;
  const Json& fields_;
};

}  // namespace

SafetensorsHeader parse_safetensors_header(std::string_view header) {
  SafetensorsHeader parsed;
  const Json json = parse_json(header, "the JSON header");
  for (const auto& [name, fields] : json.items()) {
    const HeaderItem item(name, fields);
    if (name == kMetadata) {
      parsed.metadata = item.metadata();
    } else {
      parsed.entries[name] = item.entry();
    }
  }
  return parsed;
}

uint64_t dtype_bytes(std::string_view dtype) {
  static const std::map<std::string_view, uint64_t> widths{{"BOOL", 1}, {"U8", 1},   {"I8", 1},  {"U16", 2}, {"I16", 2},
                                                           {"F16", 2},  {"BF16", 2}, {"U32", 4}, {"I32", 4}, {"F32", 4},
                                                           {"U64", 8},  {"I64", 8},  {"F64", 8}};
  const auto found = widths.find(dtype);
  return found == widths.end() ? 0 : found->second;
}

std::string shape_text(const std::vector<int64_t>& shape) {
  std::string result = "[";
  for (size_t i = 0; i < shape.size(); ++i) result += text(i > 0 ? "," : "", shape[i]);
  return result + "]";
}

std::string json_string(const std::string& value) {
  try {
    return Json(value).dump();
  } catch (const Json::exception&) {
    throw Error(Fault::internal, text("'", printable(value), "' is not valid UTF-8 and cannot be saved as a name"));
  }
}

std::string json_text(const SafetensorsEntry& entry) {
  return text(R"({"dtype":")", entry.dtype, R"(","shape":)", shape_text(entry.shape), R"(,"data_offsets":[)",
              entry.begin, ",", entry.end, "]}");
}

std::string printable(std::string_view name) {
  std::string result(name.substr(0, 80));
  for (char& c : result) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return name.size() > 80 ? result + "..." : result;
}

}  // namespace cloam
