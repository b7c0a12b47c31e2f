// Parsed as a stream of events, so that a hostile header can neither nest deeply nor build a large document first.
#include "models/io/safetensors_header.h"

#include <array>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "runtime/error.h"

namespace cloam {
namespace {

using nlohmann::json;

constexpr size_t kMaxRank = 16;

/// Each event either fits the place where it occurs or ends the parse with an Error.
class HeaderEvents : public nlohmann::json_sax<json> {
 public:
  SafetensorsHeader header;

  bool null() override { return refuse("null"); }
  bool boolean(bool) override { return refuse("a boolean"); }
  bool number_integer(number_integer_t value) override { return refuse(text("the negative number ", value)); }
  bool number_float(number_float_t, const string_t& digits) override {
    return refuse("the number " + printable(digits));
  }
  bool binary(binary_t&) override { return refuse("binary data"); }

  bool number_unsigned(number_unsigned_t value) override {
    if (place_ != Place::array) return refuse(text("the number ", value));
    if (numbers_.size() == kMaxRank) return refuse(text("more than ", kMaxRank, " numbers"));
    numbers_.push_back(value);
    return true;
  }

  bool string(string_t& value) override {
    if (place_ == Place::metadata) {
      header.metadata[key_] = value;
    } else if (place_ == Place::entry && key_ == "dtype") {
      entry_.dtype = value;
    } else {
      return refuse("a string");
    }
    return true;
  }

  bool start_object(size_t) override {
    if (place_ == Place::outside) {
      place_ = Place::top;
    } else if (place_ == Place::top) {
      place_ = name_ == "__metadata__" ? Place::metadata : Place::entry;
      entry_ = {};
      fields_seen_ = {};
    } else {
      return refuse("an object");
    }
    return true;
  }

  bool end_object() override {
    if (place_ == Place::entry) finish_entry();
    place_ = place_ == Place::top ? Place::outside : Place::top;
    return true;
  }

  bool start_array(size_t) override {
    if (place_ != Place::entry || key_ == "dtype") return refuse("an array");
    place_ = Place::array;
    numbers_.clear();
    return true;
  }

  bool end_array() override {
    place_ = Place::entry;
    if (key_ == "shape") {
      take_shape();
    } else {
      if (numbers_.size() != 2) return refuse(text(numbers_.size(), " numbers in data_offsets, need 2"));
      entry_.begin = numbers_[0];
      entry_.end = numbers_[1];
    }
    return true;
  }

  bool key(string_t& value) override {
    key_ = value;
    if (place_ == Place::top) {
      name_ = value;
      const bool repeated =
          value == "__metadata__" ? std::exchange(metadata_seen_, true) : header.entries.contains(value);
      if (repeated) return refuse("the name a second time");
    } else if (place_ == Place::metadata) {
      if (header.metadata.contains(value)) return refuse("the key '" + printable(value) + "' a second time");
    } else {
      see_field();
    }
    return true;
  }

  bool parse_error(size_t, const std::string&, const json::exception& problem) override {
    throw Error(Fault::data, "the header is not valid JSON: " + std::string(problem.what()).substr(0, 300));
  }

 private:
  enum class Place { outside, top, metadata, entry, array };
  static constexpr std::array<std::string_view, 3> kFields{"dtype", "shape", "data_offsets"};

  bool refuse(const std::string& found) const {
    throw Error(Fault::data,
                text("header of tensor '", printable(name_), "': found ", found, " at key '", printable(key_),
                     "', want {\"dtype\":string, \"shape\":[sizes], \"data_offsets\":[begin,end]}"));
  }

  void see_field() {
    for (size_t i = 0; i < kFields.size(); ++i) {
      if (key_ != kFields[i]) continue;
      if (std::exchange(fields_seen_[i], true)) refuse("the key a second time");
      return;
    }
    refuse("an unknown key");
  }

  void finish_entry() {
    for (size_t i = 0; i < kFields.size(); ++i) {
      if (!fields_seen_[i]) refuse(text("no ", kFields[i]));
    }
    header.entries[name_] = std::move(entry_);
  }

  void take_shape() {
    for (const uint64_t extent : numbers_) {
      if (extent > uint64_t{std::numeric_limits<int64_t>::max()}) refuse(text("the size ", extent));
      entry_.shape.push_back(static_cast<int64_t>(extent));
    }
  }

  Place place_ = Place::outside;
  std::string name_, key_;
  SafetensorsEntry entry_;
  std::array<bool, 3> fields_seen_{};
  bool metadata_seen_ = false;
  std::vector<uint64_t> numbers_;
};

}  // namespace

SafetensorsHeader parse_safetensors_header(std::string_view header) {
  HeaderEvents events;
  json::sax_parse(header, &events);
  return std::move(events.header);
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
    return json(value).dump();
  } catch (const json::exception&) {
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
