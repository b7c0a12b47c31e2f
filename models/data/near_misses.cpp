// See near_misses.h.
#include "models/data/near_misses.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <set>

#include "models/io/image.h"
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

/// "a%20b" is "a b".
std::string without_escapes(const std::string& name) {
  std::string out;
  for (std::size_t i = 0; i < name.size(); ++i) {
    int code = 0;
    const char* const from = name.data() + i + 1;
    const bool escape =
        name[i] == '%' && i + 2 < name.size() && std::from_chars(from, from + 2, code, 16).ptr == from + 2;
    out += escape ? static_cast<char>(code) : name[i];
    if (escape) i += 2;
  }
  return out;
}

/// UTF-8 without Latin letters that have accents, written as one character (as on Linux and Windows) or as a letter and
/// a mark (as macOS keeps names).
std::string without_accented(const std::string& name) {
  std::string out;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const auto first = static_cast<unsigned char>(name[i]);
    const bool letter = first >= 0xc3 && first <= 0xc5, mark = first == 0xcc || first == 0xcd;
    if (mark && !out.empty() && i > 0 && static_cast<unsigned char>(name[i - 1]) < 0x80) out.pop_back();
    if (letter || mark)
      ++i;  // of two bytes
    else
      out += name[i];
  }
  return out;
}

/// Accents as characters of their own.
bool has_marks(const std::string& name) { return name.find_first_of("\xcc\xcd") != std::string::npos; }

/// What is left of a name when spellings of it do not differ.
std::string plain_stem(const fs::path& name) {
  return lower_case(without_accented(without_escapes(name.stem().string())));
}

/// What a file is by its extension: images stand for each other.
std::string kind_of(const fs::path& name) {
  const bool image = name.extension().empty() || is_image_name(name) || is_heic_name(name);
  return image ? "image" : lower_case(name.extension().string());
}

/// Files below a folder by the plain stems of their names.
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
      by_stem_[plain_stem(name)].insert(name.generic_string());
    }
  }

  /// Another file of the same stem and kind, in the same folder or, if it may be and none is named or it does not exist
  /// or is empty, in any; "" if none is.
  std::string like(const std::string& missing, bool any_folder) const {
    const fs::path wanted = with_slashes(missing);
    const auto found = by_stem_.find(plain_stem(wanted));
    if (found == by_stem_.end()) return "";
    const std::string folder = lower_case(wanted.parent_path().generic_string());
    std::string elsewhere;
    for (const std::string& name : found->second) {
      const bool itself = name == fs::path(missing).lexically_normal().generic_string();
      if (itself || kind_of(name) != kind_of(wanted)) continue;
      if (lower_case(fs::path(name).parent_path().generic_string()) == folder) return name;
      if (elsewhere.empty()) elsewhere = name;
    }
    std::error_code error;
    const bool right_folder = !folder.empty() && fs::is_directory(root_ / wanted.parent_path(), error) &&
                              !fs::is_empty(root_ / wanted.parent_path(), error);
    return any_folder && !right_folder ? elsewhere : "";
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

std::string near_misses(const fs::path& root, const std::vector<std::string>& missing, bool any_folder) {
  if (missing.empty()) return "";
  const Files files(root);
  std::size_t near = 0;
  std::string first, fix;
  for (const std::string& name : missing) {
    std::error_code error;
    const bool dangling = fs::is_symlink(root / name, error);
    const std::string found = dangling ? "" : files.like(name, any_folder);
    if ((!dangling && found.empty()) || ++near > 1) continue;
    first = dangling ? name + " is a link to a missing file" : text(found, " is there instead of ", name);
    fix = dangling ? "repair the link" : is_heic_name(found) ? kConvertHeic : "rename the files, or correct the list";
    if (!dangling && has_marks(found) != has_marks(name) && without_accented(found) == without_accented(name))
      fix = "the accents are written in two ways (Unicode's NFC and NFD); " + fix;
  }
  if (near == 0) return "";
  return text("; ", first, near > 1 ? text(" (and ", near - 1, " more like it)") : "", ": ", fix);
}

}  // namespace cloam
