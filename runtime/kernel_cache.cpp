// See kernel_cache.h.
#include "runtime/kernel_cache.h"

#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "runtime/error.h"
#include "runtime/kernel_files.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMinMegabytes = 32;  // the kernels of a training take about 10

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

/// As PoCL looks for it; empty without any of the variables.
fs::path folder_of_pocl() {
  if (const std::string own = variable("POCL_CACHE_DIR"); !own.empty()) return own;
  if (const std::string xdg = variable("XDG_CACHE_HOME"); !xdg.empty()) return fs::path(xdg) / "pocl";
  if (const std::string home = variable("HOME"); !home.empty()) return fs::path(home) / ".cache" / "pocl";
  return {};
}

/// PoCL's own choice has a folder more.
std::string mended(const fs::path& folder) {
  const int programs = remove_damaged_kernels(folder) + remove_damaged_kernels(folder / "kcache");
  return programs == 0
             ? ""
             : text(programs, " compiled programs in ", folder.string(), " were damaged and are compiled again");
}

/// Why the folder, which exists, cannot take kernels; empty if it can. Permission bits do not tell: a try does.
std::string problem_inside(const fs::path& folder) {
  std::string probe = (folder / ".cloam-XXXXXX").string();
  const int file = ::mkstemp(probe.data());
  if (file < 0) return std::strerror(errno);
  ::close(file);
  ::unlink(probe.c_str());
  struct statvfs disk {};
  if (::statvfs(folder.c_str(), &disk) != 0) return "";
  const uint64_t free = (uint64_t{disk.f_bavail} * disk.f_frsize) >> 20;
  return free < kMinMegabytes ? text("only ", free, " MB are free there, want ", kMinMegabytes) : "";
}

/// The same of a folder that is made if absent.
std::string problem_of(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  return error ? error.message() : problem_inside(folder);
}

fs::path temporary_folder() {
  std::error_code error;
  const fs::path all = fs::temp_directory_path(error);
  return (error ? fs::path("/tmp") : all) / text("cloam-kernels-", ::geteuid());
}

/// Kernels are machine code, and anybody may write to /tmp: a folder that another user made or may write to is none.
std::string problem_of_private(const fs::path& folder) {
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) return std::strerror(errno);
  struct stat found {};
  const bool is_own = ::lstat(folder.c_str(), &found) == 0 && S_ISDIR(found.st_mode) && found.st_uid == ::geteuid() &&
                      (found.st_mode & 077) == 0;
  return is_own ? problem_inside(folder) : "it exists but is not a private folder of this user";
}

KernelCache decide() {
  if (variable("POCL_CACHE_DIR").empty()) ::unsetenv("POCL_CACHE_DIR");  // PoCL ends the process where it is empty
  const fs::path wanted = folder_of_pocl(), temporary = temporary_folder();
  const std::string problem = wanted.empty() ? "HOME is not set" : problem_of(wanted);
  if (problem.empty()) return {mended(wanted), true};
  const std::string reason = wanted.empty() ? problem : text(wanted.string(), ": ", problem);
  const std::string other = problem_of_private(temporary);
  if (!other.empty()) {
    return {text("there is no folder for compiled kernels (", reason, "; ", temporary.string(), ": ", other,
                 ")\n  fix: set POCL_CACHE_DIR to a folder that you may write to, with ", kMinMegabytes, " MB free"),
            false};
  }
  ::setenv("POCL_CACHE_DIR", temporary.c_str(), 1);
  (void)mended(temporary);
  return {
      text("compiled kernels are kept in ", temporary.string(), " (", reason, "); POCL_CACHE_DIR names another folder"),
      true};
}

}  // namespace

const KernelCache& kernel_cache() {
  static const KernelCache cache = decide();
  return cache;
}

}  // namespace cloam
