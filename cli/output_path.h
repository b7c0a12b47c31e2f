// Where a command writes, checked while the command line is read: before any work, and the same for all commands.
#pragma once
#include <filesystem>
#include <string>

namespace CLI {
class Validator;
}

namespace cloam {

/// For an option that names a folder: no "-" (nothing is written to stdout), no file, nothing below a file, and no name
/// that is a file's ("orbit.gif") unless it is a folder's already.
CLI::Validator output_folder();
/// For an option that names a file: no "-", no folder, nothing below a file.
CLI::Validator output_file();
/// For one that names either: no "-", nothing below a file.
CLI::Validator output_path();

/// The file that --format and its name give together: with the format's extension where it has none that is a file's.
/// Fault::usage where they contradict each other. format: as "glb"; empty: what the name says.
std::filesystem::path with_format(const std::filesystem::path& path, const std::string& format);

}  // namespace cloam
