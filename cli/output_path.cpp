// Where a command writes, checked while the command line is read: before any work, and the same for all commands.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

#include "cli/options.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

const char* const kFileExtensions[] = {".avi",         ".csv",  ".exr",   ".gif",  ".glb", ".html", ".jpeg",
                                       ".jpg",         ".json", ".mov",   ".mp4",  ".npz", ".ply",  ".png",
                                       ".safetensors", ".spz",  ".splat", ".webm", ".zip"};

bool is_file_name(const fs::path& path) {
  const std::string extension = lower_case(path.extension().string());
  return std::find(std::begin(kFileExtensions), std::end(kFileExtensions), extension) != std::end(kFileExtensions);
}

std::string problem_of_place(const std::string& given, const char* wanted) {
  if (given == "-") return text("-: nothing is written to standard output; name ", wanted);
  const fs::path file = file_in_the_way(fs::path(given).parent_path());
  return file.empty() ? "" : text(given, ": ", file.string(), " is a file, not a folder; choose another path");
}

std::string problem_of_folder(const std::string& given) {
  std::error_code ignored;
  if (const std::string problem = problem_of_place(given, "a folder"); !problem.empty()) return problem;
  if (fs::is_directory(given, ignored)) return "";
  if (fs::exists(given, ignored)) return given + " is a file; name a folder";
  if (!is_file_name(given)) return "";
  return text(given, " is a file name, but several files are written; name a folder for them, such as ",
              fs::path(given).replace_extension().string());
}

std::string problem_of_file(const std::string& given) {
  std::error_code ignored;
  if (const std::string problem = problem_of_place(given, "a file"); !problem.empty()) return problem;
  if (fs::is_other(given, ignored)) return given + " is a device or a pipe; name a file";
  return fs::is_directory(given, ignored) ? given + " is a folder; name a file" : "";
}

}  // namespace

CLI::Validator output_folder() { return CLI::Validator(problem_of_folder, ""); }
CLI::Validator output_file() { return CLI::Validator(problem_of_file, ""); }
CLI::Validator output_path() {
  return CLI::Validator([](const std::string& given) { return problem_of_place(given, "a file or folder"); }, "");
}

fs::path with_format(const fs::path& path, const std::string& format) {
  const std::string extension = "." + format;
  if (format.empty() || lower_case(path.extension().string()) == extension) return path;
  if (!is_file_name(path)) return path.string() + extension;
  throw Error(Fault::usage,
              text("--format ", format, " contradicts -o ", path.string(), ": leave out --format, or name the file ",
                   fs::path(path).replace_extension(extension).string()));
}

}  // namespace cloam
