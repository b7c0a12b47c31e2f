// Disks without room, in two ways: a limit on the size of files, which refuses a write at the very call where a full
// disk does and needs no rights; and a file system in memory, where it may be mounted.
#pragma once
#include <sys/mount.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>

namespace cloam {

/// While it lives no file of this process, or of those that it starts, grows beyond so many bytes.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : action_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, action_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  void (*action_)(int);
  rlimit before_{};
};

/// A file system of `kilobytes` at an empty folder, filled up; gone with this.
class FullDisk {
 public:
  FullDisk(const std::filesystem::path& folder, int kilobytes) : folder_(folder) {
    std::filesystem::create_directories(folder);
    const std::string size = "size=" + std::to_string(kilobytes) + "k";
    mounted_ = ::mount("none", folder.c_str(), "tmpfs", 0, size.c_str()) == 0;
  }
  ~FullDisk() {
    if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

  /// Without the rights to mount there is none.
  bool mounted() const { return mounted_; }
  void fill() const { std::ofstream(folder_ / "filler") << std::string(1 << 20, 'x'); }

 private:
  std::filesystem::path folder_;
  bool mounted_ = false;
};

}  // namespace cloam
