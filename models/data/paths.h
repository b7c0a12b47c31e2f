// Paths that come from a data set's own files. They must stay inside its folder, links included, so that a data set
// from a stranger can neither read nor probe for other files.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

/// The real path of `relative` below the folder `root` (which may itself be a link). It need not exist.
/// Fault::data for an absolute path, a "..", a control character, or a link that leads out: the same error whether
/// or not anything lies there.
std::filesystem::path resolve_inside(const std::filesystem::path& root, const std::string& relative);

/// A regular file, or a link to one.
bool is_file(const std::filesystem::path& path);

/// The name among `names` that is most like `wanted`, or "" if none is near: for "did you mean".
std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names);

}  // namespace cloam
