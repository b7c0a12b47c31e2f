// See paths.h.
#include "models/data/paths.h"

#include <algorithm>
#include <numeric>

#include "models/io/bytes.h"
#include "models/io/safetensors_header.h"  // printable

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestPath = 4096;  // as Linux
constexpr std::size_t kLongestName = 200;   // that is compared letter by letter

[[noreturn]] void refuse(const std::string& named, const std::string& why) {
  throw Error(Fault::data, text("the path \"", printable(named), "\" ", why));
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

// Levenshtein's distance, one row at a time.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, diagonal + 1});
    }
  }
  return row[b.size()];
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
  refuse(named, text("leaves the data folder ", root.string(),
                     "; add --allow-outside if you trust this data set, else copy or link the files into the folder"));
}

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

bool has_file(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) return false;
  if (!fs::is_regular_file(status)) file_bytes(path);  // says what it is
  return true;
}

std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names) {
  std::string nearest;
  if (wanted.size() > kLongestName) return nearest;
  std::size_t least = wanted.size() / 3 + 2;  // a typing error or two, not another word
  for (const std::string& name : names) {
    const std::size_t longer = std::max(wanted.size(), name.size()), shorter = std::min(wanted.size(), name.size());
    if (longer - shorter >= least) continue;
    const std::size_t distance = edit_distance(wanted, name);
    if (distance >= least) continue;
    least = distance;
    nearest = name;
  }
  return nearest;
}

}  // namespace cloam
