// Where missing files may be instead: renamed, in other letter case, in another folder, or of a kind that is not read.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

/// For the end of a message about files that a list names and that `root` lacks: "; images/a.JPG is there instead of
/// images/a.jpg (and 3 more like it): rename ...", or "" where nothing is near. any_folder: false where folders number
/// their files alike, as those of logs do, so that one of the same name elsewhere is another.
std::string near_misses(const std::filesystem::path& root, const std::vector<std::string>& missing,
                        bool any_folder = true);

/// The first five names: "a, b, c, d, e, ...".
std::string some_of(const std::vector<std::string>& names);

/// Photos of telephones (.heic, .heif), which `process` alone reads. In any letter case.
bool is_heic_name(const std::filesystem::path& path);
/// What to do about those that stand in the place of photos that a capture lists.
inline constexpr char kConvertHeic[] = "convert HEIC photos to JPEG first: mogrify -format jpg *.heic (ImageMagick)";

/// By the extension: a video, of which `process` makes a capture. In any letter case.
bool is_video_name(const std::filesystem::path& path);
/// The command that does.
std::string process_command(const std::filesystem::path& video);

}  // namespace cloam
