// The order of the calls follows "All File Systems Are Not Created Equal" (OSDI 2014): write, fsync, close, rename,
// fsync of the folder; each result is checked, since disks report "full" and "broken" as late as at close.
#include "models/io/commit.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <string>
#include <system_error>
#include <utility>

#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTemporaryMark = ".tmp-";

fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : fs::path("."); }

/// The nearest folder on the way up that exists.
fs::path existing_folder(const fs::path& folder) {
  std::error_code problem;
  fs::path found = fs::absolute(folder, problem).lexically_normal();
  while (found.has_relative_path() && !fs::is_directory(found, problem)) found = found.parent_path();
  return found;
}

/// Where the disk is mounted that the folder lies on.
fs::path mount_point(const fs::path& folder) {
  struct stat here {};
  struct stat above {};
  std::error_code problem;
  fs::path found = fs::canonical(folder, problem);
  if (problem || ::stat(found.c_str(), &here) != 0) return folder;
  while (found.has_relative_path() && ::stat(found.parent_path().c_str(), &above) == 0 && above.st_dev == here.st_dev)
    found = found.parent_path();
  return found;
}

/// EIO: what a copy by std::filesystem says where it finds no room.
bool is_about_space(int code) { return code == ENOSPC || code == EDQUOT || code == EFBIG || code == EIO; }

[[noreturn]] void fail(std::string_view action, const fs::path& path, int code, uint64_t needed = 0) {
  std::string message = text("cannot ", action, " ", path.string(), ": ", std::strerror(code));
  if (is_about_space(code)) {
    if (needed > 0) message += text("; needs ", needed, " bytes");
    message += "; " + space_advice(folder_of(path));
  }
  if (code == EACCES || code == EPERM || code == EROFS || code == ENOENT)
    message += "; choose a folder that you may write to";
  const fs::path file = code == ENOTDIR || code == EEXIST ? file_in_the_way(path) : fs::path();
  if (!file.empty()) message += text("; ", file.string(), " is a file: name another folder");
  throw Error(Fault::write, message);
}

/// A file descriptor that is closed on all ways out; close() is the way that reports. Errors name `told`, the file that
/// the user knows of.
class Descriptor {
 public:
  Descriptor(const fs::path& path, int flags, const fs::path& told)
      : path_(told), file_(::open(path.c_str(), flags | O_CLOEXEC, 0666)) {
    if (file_ < 0) fail("write", told, errno);
  }
  ~Descriptor() {
    if (file_ >= 0) ::close(file_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int get() const { return file_; }
  void sync() const {
    if (::fsync(file_) != 0) fail("flush to disk", path_, errno);
  }
  void close() {
    const int file = std::exchange(file_, -1);
    if (::close(file) != 0) fail("close", path_, errno);
  }

 private:
  fs::path path_;
  int file_;
};

/// Removes the temporary file unless it has been renamed away.
struct TemporaryFile {
  fs::path path;
  ~TemporaryFile() {
    if (!path.empty()) ::unlink(path.c_str());
  }
};

fs::path temporary_name(const fs::path& path) {
  static std::atomic<uint64_t> count{0};
  const std::string stem = path.stem().string().substr(0, 160);  // names longer than 255 bytes are refused by the disk
  return folder_of(path) / text(".", stem, kTemporaryMark, ::getpid(), "-", count++, path.extension().string());
}

void make_folder(const fs::path& folder) {
  std::error_code problem;
  fs::create_directories(folder, problem);
  if (problem) fail("make the folder", folder, problem.value());
}

void sync_path(const fs::path& path, int flags, const fs::path& told) {
  Descriptor file(path, O_RDONLY | flags, told);
  file.sync();
  file.close();
}

void call_writer(const fs::path& path, const fs::path& temp, const std::function<void(const fs::path&)>& write) {
  try {
    write(temp);
  } catch (const Error&) { throw; } catch (const std::system_error& problem) {
    fail("write", path, problem.code().value());
  } catch (const std::exception& problem) {
    throw Error(Fault::write, text("cannot write ", path.string(), ": ", problem.what()));
  }
}

void write_all(const Descriptor& file, const fs::path& path, std::span<const std::byte> bytes, uint64_t needed) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(file.get(), bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) fail("write", path, count < 0 ? errno : EIO, needed);
    bytes = bytes.subspan(static_cast<size_t>(count));
  }
}

void commit_pieces(const fs::path& path, uint64_t needed, const std::function<void(const ByteSink&)>& write) {
  commit_file(path, [&](const fs::path& temp) {
    Descriptor file(temp, O_WRONLY | O_CREAT | O_EXCL, path);
    write([&](std::span<const std::byte> bytes) { write_all(file, path, bytes, needed); });
    file.close();
  });
}

/// The process id in the name of a temporary file, 0 for any other file.
pid_t writer_of(const std::string& name) {
  const size_t mark = name.rfind(kTemporaryMark);
  if (name.empty() || name[0] != '.' || mark == std::string::npos) return 0;
  pid_t writer = 0;
  std::from_chars(name.data() + mark + kTemporaryMark.size(), name.data() + name.size(), writer);
  return writer;
}

bool is_alive(pid_t process) { return ::kill(process, 0) == 0 || errno != ESRCH; }

std::string lock_holder(int file) {
  char content[32] = {};
  const ssize_t count = ::pread(file, content, sizeof(content) - 1, 0);
  const std::string_view holder(content, count > 0 ? static_cast<size_t>(count) : 0);
  return holder.empty() ? "unknown" : std::string(holder.substr(0, holder.find('\n')));
}

/// Whether `path` still names the open file: its holder may have removed it between our open and our flock.
bool is_same_file(const fs::path& path, int file) {
  struct stat named {};
  struct stat opened {};
  return ::stat(path.c_str(), &named) == 0 && ::fstat(file, &opened) == 0 && named.st_ino == opened.st_ino;
}

}  // namespace

void commit_file(const fs::path& path, const std::function<void(const fs::path& temp)>& write) {
  std::error_code ignored;
  if (fs::is_other(path, ignored))  // a file would take the place of /dev/null
    throw Error(Fault::write, text("cannot write ", path.string(), ": it is a device or a pipe; name a file"));
  const fs::path folder = folder_of(path);
  make_folder(folder);
  TemporaryFile temp{temporary_name(path)};
  call_writer(path, temp.path, write);
  sync_path(temp.path, 0, path);
  if (::rename(temp.path.c_str(), path.c_str()) != 0) fail("move into place", path, errno);
  temp.path.clear();
  sync_path(folder, O_DIRECTORY, path);
}

void commit_stream(const fs::path& path, const std::function<void(const ByteSink& sink)>& write) {
  commit_pieces(path, 0, write);
}

void commit_bytes(const fs::path& path, std::span<const std::span<const std::byte>> parts) {
  uint64_t needed = 0;
  for (const auto& part : parts) needed += part.size();
  commit_pieces(path, needed, [&](const ByteSink& sink) {
    for (const auto& part : parts) sink(part);
  });
}

void commit_bytes(const fs::path& path, std::span<const std::byte> bytes) {
  commit_bytes(path, std::span<const std::span<const std::byte>>(&bytes, 1));
}

void commit_text(const fs::path& path, std::string_view content) {
  commit_bytes(path, std::as_bytes(std::span(content)));
}

void commit_link(const fs::path& from, const fs::path& to) {
  std::error_code error;
  if (fs::equivalent(from, to, error)) return;
  commit_file(to, [&](const fs::path& temp) {
    std::error_code failed;
    fs::remove(temp, failed);
    const fs::path file = fs::canonical(from);
    fs::create_hard_link(file, temp, failed);
    if (failed) fs::copy_file(file, temp, fs::copy_options::overwrite_existing);
  });
}

fs::path file_in_the_way(const fs::path& folder) {
  std::error_code problem;
  for (fs::path part = folder; !part.empty() && part != part.parent_path(); part = part.parent_path())
    if (fs::exists(part, problem)) return fs::is_directory(part, problem) ? fs::path() : part;
  return {};
}

std::string space_advice(const fs::path& folder) {
  struct statvfs disk {};
  const fs::path existing = existing_folder(folder);
  const std::string advice = "free space there or choose another folder";
  if (::statvfs(existing.c_str(), &disk) != 0) return advice;
  return text(uint64_t{disk.f_bavail} * disk.f_frsize, " bytes are free on ", mount_point(existing).string(), "; ",
              advice);
}

void remove_stale_temporaries(const fs::path& folder) {
  for (const fs::path& entry : entries_of(folder)) {
    const pid_t writer = writer_of(entry.filename().string());
    if (writer > 0 && !is_alive(writer)) ::unlink(entry.c_str());
  }
}

FolderLock::FolderLock(const fs::path& folder) : path_(folder / ".lock") {
  make_folder(folder);
  for (;;) {
    file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file_ < 0) fail("open the lock", path_, errno);
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
      const std::string holder = lock_holder(file_);
      ::close(file_);
      throw Error(Fault::usage, text("the folder ", folder.string(), " is in use by process ", holder,
                                     "; wait for it to end or choose another output folder"));
    }
    if (is_same_file(path_, file_)) break;
    ::close(file_);
  }
  const std::string holder = text(::getpid(), "\n");
  if (::ftruncate(file_, 0) != 0 || ::pwrite(file_, holder.data(), holder.size(), 0) < 0) {
    const int code = errno;
    ::unlink(path_.c_str());
    ::close(file_);
    fail("write the lock", path_, code);
  }
}

FolderLock::~FolderLock() {
  // Removed before it is let go of, so that nobody's fresh lock file is removed by mistake.
  ::unlink(path_.c_str());
  ::close(file_);
}

}  // namespace cloam
