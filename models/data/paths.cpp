// See paths.h.
#include "models/data/paths.h"

#include <algorithm>
#include <deque>
#include <numeric>

#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as Linux

[[noreturn]] void refuse(const std::string& relative, const char* why) {
  std::string shown = relative.substr(0, 200);
  std::replace_if(
      shown.begin(), shown.end(), [](unsigned char c) { return c < 32 || c == 127; }, '?');
  throw Error(Fault::data,
              text("the path \"", shown, "\" ", why,
                   "; paths in a data set are relative and stay inside its folder (copy the files there)"));
}

bool lies_within(const fs::path& folder, const fs::path& path) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first == folder.end();
}

// Follows links by hand: weakly_canonical() keeps a link whose target is missing and so would tell targets apart.
fs::path follow_links(const fs::path& root, const fs::path& relative, const std::string& shown) {
  std::deque<fs::path> parts(relative.begin(), relative.end());
  fs::path current = root;
  for (int links = 0; !parts.empty();) {
    const fs::path part = parts.front();
    parts.pop_front();
    if (part.empty() || part == ".") continue;
    if (part == "..") {
      current = current.parent_path();
      continue;
    }
    std::error_code error;
    const fs::path next = part.is_absolute() ? part : current / part;
    if (part.is_absolute() || !fs::is_symlink(next, error)) {
      current = next;
      continue;
    }
    if (++links > kMostLinks) refuse(shown, "is a ring of links");
    const fs::path target = fs::read_symlink(next, error);
    parts.insert(parts.begin(), target.begin(), target.end());
  }
  return current;
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

fs::path resolve_inside(const fs::path& root, const std::string& relative) {
  const bool control =
      std::any_of(relative.begin(), relative.end(), [](unsigned char c) { return c < 32 || c == 127; });
  if (control) refuse(relative, "has a control character");
  if (relative.empty()) refuse(relative, "is empty");
  const fs::path path(relative);
  if (path.is_absolute()) refuse(relative, "is absolute");
  if (std::find(path.begin(), path.end(), "..") != path.end()) refuse(relative, "leaves the folder");
  std::error_code error;
  const fs::path folder = fs::weakly_canonical(root, error);
  if (error) throw Error(Fault::data, text(root.string(), ": cannot be opened: ", error.message()));
  const fs::path result = follow_links(folder, path, relative);
  if (!lies_within(folder, result)) refuse(relative, "leaves the folder by a link");
  return result;
}

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names) {
  std::string nearest;
  std::size_t least = wanted.size() / 3 + 2;  // a typing error or two, not another word
  for (const std::string& name : names) {
    const std::size_t distance = edit_distance(wanted, name);
    if (distance >= least) continue;
    least = distance;
    nearest = name;
  }
  return nearest;
}

}  // namespace cloam
