// See near_misses.h.
#include "models/data/near_misses.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxFiles = 50000;  // that are looked at
constexpr int kDeepest = 4;               // folders in folders, and rings of links

/// Written on Windows, perhaps.
fs::path with_slashes(std::string name) {
  std::replace(name.begin(), name.end(), '\\', '/');
  return fs::path(name).lexically_normal();
}

/// Files below a folder by their names in small letters and without extension.
class Files {
 public:
  explicit Files(const fs::path& root) : root_(root) {
    std::error_code error;
    fs::recursive_directory_iterator entry(
        root, fs::directory_options::follow_directory_symlink | fs::directory_options::skip_permission_denied, error);
    for (const fs::recursive_directory_iterator end; !error && entry != end && count_ < kMaxFiles;
         entry.increment(error)) {
      const bool hidden = entry->path().filename().string().starts_with('.');
      if (hidden || entry.depth() >= kDeepest) entry.disable_recursion_pending();
      ++count_;
      if (hidden || !entry->is_regular_file(error)) continue;
      const fs::path name = entry->path().lexically_relative(root);
      by_stem_[lower_case(name.stem().string())].insert(name.generic_string());
    }
  }

  /// Of the same stem, in the same folder or, where none is named or there is no such folder, in any; "" if none is.
  std::string like(const std::string& missing) const {
    const fs::path wanted = with_slashes(missing);
    const auto found = by_stem_.find(lower_case(wanted.stem().string()));
    if (found == by_stem_.end()) return "";
    const std::string folder = lower_case(wanted.parent_path().generic_string());
    for (const std::string& name : found->second)
      if (lower_case(fs::path(name).parent_path().generic_string()) == folder) return name;
    std::error_code error;
    const bool right_folder = !folder.empty() && fs::is_directory(root_ / wanted.parent_path(), error);
    return right_folder ? "" : *found->second.begin();
  }

 private:
  fs::path root_;
  std::size_t count_ = 0;
  std::map<std::string, std::set<std::string>> by_stem_;
};

bool has_extension(const fs::path& path, std::initializer_list<const char*> extensions) {
  const std::string own = lower_case(path.extension().string());
  return std::any_of(extensions.begin(), extensions.end(), [&](const char* known) { return own == known; });
}

}  // namespace

bool is_heic_name(const fs::path& path) { return has_extension(path, {".heic", ".heif"}); }

bool is_video_name(const fs::path& path) {
  return has_extension(path, {".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".insv", ".3gp"});
}

std::string process_command(const fs::path& video) { return "cloam process " + quoted(video.string()) + " -o DATA"; }

std::string some_of(const std::vector<std::string>& names) {
  constexpr std::size_t most = 5;
  const auto end = names.begin() + static_cast<std::ptrdiff_t>(std::min(most, names.size()));
  return fmt::format("{}{}", fmt::join(names.begin(), end, ", "), names.size() > most ? ", ..." : "");
}

std::string near_misses(const fs::path& root, const std::vector<std::string>& missing) {
  if (missing.empty()) return "";
  const Files files(root);
  std::size_t near = 0;
  std::string first, fix;
  for (const std::string& name : missing) {
    std::error_code error;
    const bool dangling = fs::is_symlink(root / name, error);
    const std::string found = dangling ? "" : files.like(name);
    if ((!dangling && found.empty()) || ++near > 1) continue;
    first = dangling ? name + " is a link to a missing file" : text(found, " is there instead of ", name);
    fix = dangling ? "repair the link" : is_heic_name(found) ? kConvertHeic : "rename the files, or correct the list";
  }
  if (near == 0) return "";
  return text("; ", first, near > 1 ? text(" (and ", near - 1, " more like it)") : "", ": ", fix);
}

}  // namespace cloam
