// See shipped.h.
#include "cli/shipped.h"

#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// bin/cloam and share/cloam/shipped stand in one folder, in a build and installed alike.
fs::path folder_of(const char* kind) {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  return program.parent_path().parent_path() / "share" / "cloam" / kShipped / kind;
}

std::string shipped(const std::string& given, const char* kind) {
  if (given != kShipped) return given;
  std::error_code error;
  const fs::path folder = folder_of(kind);
  if (fs::is_directory(folder, error)) return folder.string();
  throw Error(Fault::usage, text("no shipped ", kind, " come with this program; looked for ", folder.string(),
                                 "\n  fix: train your own: cloam train genassets LOG... -o RUN, then cloam train "
                                 "diffusion RUN -o RUN2, and name RUN or RUN2"));
}

}  // namespace

std::string networks_named(const std::string& given) { return shipped(given, "networks"); }
std::string prior_named(const std::string& given) { return shipped(given, "assets"); }

bool ships_prior() {
  std::error_code error;
  return fs::is_directory(folder_of("assets"), error);
}

}  // namespace cloam
