// See paths.h.
#include "models/io/paths.h"

#include <algorithm>

#include "models/io/bytes.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/nearest_name.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestPath = 4096;  // as Linux

[[noreturn]] void refuse(const std::string& named, const std::string& why) {
  bad_data("the path \"", printable(named), "\" ", why);
}

bool lies_within(const fs::path& folder, const fs::path& path) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first == folder.end();
}

// The rest of an absolute path below the root, which may go by another name there (a link, a mount); else empty.
fs::path rest_below(const fs::path& root, const fs::path& path) {
  fs::path above;
  for (auto part = path.begin(); part != path.end(); ++part) {
    above /= *part;
    std::error_code error;
    if (!fs::equivalent(above, root, error)) continue;
    fs::path rest;
    for (++part; part != path.end(); ++part) rest /= *part;
    return rest;
  }
  return {};
}

/// The longest end of a path that leads out at which the folder itself has a file; "" if there is none.
std::string end_within(const fs::path& root, const fs::path& path) {
  for (auto part = path.begin(); part != path.end(); ++part) {
    fs::path end;
    for (auto rest = part; rest != path.end(); ++rest) end /= *rest;
    const bool inside = end.is_relative() && *end.begin() != "..";
    if (inside && is_file(root / end)) return end.generic_string();
  }
  return "";
}

}  // namespace

std::string path_named(const fs::path& root, const std::string& named, bool allow_outside) {
  const bool control = std::any_of(named.begin(), named.end(), [](unsigned char c) { return c < 32 || c == 127; });
  if (control) refuse(named, "has a control character");
  if (named.empty()) refuse(named, "is empty");
  if (named.size() > kLongestPath) refuse(named, text("has ", named.size(), " characters"));
  const fs::path given = fs::path(named).lexically_normal();
  const fs::path target = (root / given).lexically_normal();
  if (lies_within(root, target)) return target.lexically_relative(root).generic_string();
  const fs::path rest = given.is_absolute() ? rest_below(root, given) : fs::path();
  if (!rest.empty()) return rest.generic_string();
  if (allow_outside) return given.generic_string();
  if (const std::string end = end_within(root, given); !end.empty())
    refuse(named, text("leaves the data folder ", root.string(), ", which has ", end,
                       ": was the list written on another machine?\n  fix: write ", end,
                       " there, and the others alike; --allow-outside is for files that are meant to be elsewhere"));
  refuse(named, text("leaves the data folder ", root.string(),
                     "; add --allow-outside if you trust this data set, or copy or link the files into the folder"));
}

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    entries.push_back(entry->path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

std::string did_you_mean_path(const fs::path& missing) {
  const fs::path clean = missing.has_filename() ? missing : missing.parent_path();  // "data/fox/" ends in an empty name
  const fs::path folder = clean.parent_path();
  std::vector<std::string> names;
  for (const fs::path& entry : entries_of(folder.empty() ? "." : folder)) names.push_back(entry.filename().string());
  const std::string near = nearest_name(clean.filename().string(), names);
  return near.empty() ? "" : "; did you mean " + (folder / near).string() + "?";
}

bool has_file(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) return false;
  if (!fs::is_regular_file(status)) file_bytes(path);  // says what it is
  return true;
}

}  // namespace cloam
