// Strict access to JSON that others wrote: every missing key, wrong type or number that is not finite is an Error
// (Fault::data) that names the place. `where` is that place in words ("transforms.json, frame 3 (images/0004.jpg)").
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace cloam {

using Json = nlohmann::json;

/// Errors name line and column where there is one: over 256 MB, not JSON, nested deeper than 64, a key twice in one
/// object, more values than 512 MB hold. The time grows with the number of bytes: 1 to 2 s for 100 MB.
/// The words NaN, Infinity and -Infinity, which Python writes although they are not JSON, become null: a reader that
/// wants a number there then names the very entry, and entries that nobody needs do no harm.
Json parse_json_file(const std::filesystem::path& path);

/// The same for text in memory; `name` stands at the head of errors.
Json parse_json(std::string_view given, const std::string& name);

/// use(value, number) for each value of a file that is a list, one in memory at a time: for tables of gigabytes. Errors
/// as parse_json_file, but of size; values that are not JSON, as Python's NaN, are one. Fault::data for a file that is
/// no list.
void for_each_in_json_file(const std::filesystem::path& path,
                           const std::function<void(const Json& value, std::size_t number)>& use);

/// The value of a key that must be there.
const Json& member(const Json& object, const std::string& key, const std::string& where);

double number(const Json& object, const std::string& key, const std::string& where);
std::string string(const Json& object, const std::string& key, const std::string& where);
const Json& array(const Json& object, const std::string& key, const std::string& where);

/// Nothing where the key is missing or null; an error where it holds another type.
std::optional<double> optional_number(const Json& object, const std::string& key, const std::string& where);
std::optional<std::string> optional_string(const Json& object, const std::string& key, const std::string& where);
bool flag(const Json& object, const std::string& key, bool otherwise, const std::string& where);

/// Rows of 4 finite numbers: 4 of them, the last 0 0 0 1, or the upper 3 alone.
Eigen::Matrix4d matrix4(const Json& object, const std::string& key, const std::string& where);

}  // namespace cloam
