// Paths that come from a data set's own files. What they name must lie in its folder, so that a data set from a
// stranger can neither read nor probe for other files, unless the user allows it. Links on the disk are followed: the
// user made them.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "runtime/error.h"

namespace cloam {

/// `named` as scenes keep it: relative to the folder `root` if it lies there, also where it was absolute; else as it
/// is.
/// ".." is taken back by name, before any link is followed. Fault::data for an empty path, one with a control character
/// and, unless allow_outside, one that leaves the folder: the same error whether or not anything lies there.
std::string path_named(const std::filesystem::path& root, const std::string& named, bool allow_outside);

/// A regular file, or a link to one. Never throws.
bool is_file(const std::filesystem::path& path);

/// "; did you mean PATH?", what is named most like it in its folder, or "". Never throws.
std::string did_you_mean_path(const std::filesystem::path& missing);

/// What lies in a folder, sorted; nothing where it cannot be read. Never throws.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder);

/// Whether the file that a data set names is there. Fault::data for what is there and is no regular file (a folder, a
/// device, a pipe, a link to one) and for what may not be looked at.
bool has_file(const std::filesystem::path& path);

/// Runs `read`, which takes `file` apart. Where that is a link, an error about its content says nothing of the content:
/// a data set from a stranger can link to any file of the user's.
template <class Read>
auto without_quotes(const std::filesystem::path& file, Read read) {
  try {
    return read();
  } catch (const Error& error) {
    std::error_code ignored;
    if (error.fault() != Fault::data || !std::filesystem::is_symlink(file, ignored)) throw;
    bad_data(file.string(), ": the file that this link leads to is damaged or of another kind");
  }
}

}  // namespace cloam
