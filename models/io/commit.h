// The one way in which a file that matters reaches the disk: temporary file in the same folder, fsync, rename, fsync of
// the folder. A kill or a power cut at any moment leaves the old file or the new one, never a half-written one.
// Also the lock that keeps two programs out of one run folder.
#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace cloam {

/// Lets `write` make a temporary file and puts it in the place of `path`, as a whole and durably.
/// The temporary file lies in the folder of `path` (made if absent) and has its extension, so that image writers which
/// choose a format by name may write it. When anything fails, the temporary file is removed and `path` stays as it was.
/// `write` must tell when it fails: a library that hides what the disk refuses writes to memory instead (commit_bytes).
/// Errors: an Error thrown by `write` as it is; all else Fault::write with the path and the reason.
void commit_file(const std::filesystem::path& path,
                 const std::function<void(const std::filesystem::path& temp)>& write);

/// Takes the next bytes of a file.
using ByteSink = std::function<void(std::span<const std::byte> bytes)>;

/// commit_file of the bytes that `write` hands over, so that they need not all lie in memory.
void commit_stream(const std::filesystem::path& path, const std::function<void(const ByteSink& sink)>& write);

/// commit_file of the given bytes, the parts one after the other.
void commit_bytes(const std::filesystem::path& path, std::span<const std::span<const std::byte>> parts);
void commit_bytes(const std::filesystem::path& path, std::span<const std::byte> bytes);
void commit_text(const std::filesystem::path& path, std::string_view content);

/// commit_file of the bytes of another file: a hard link where both lie on one disk, else a copy. Nothing where they
/// are the same file.
void commit_link(const std::filesystem::path& from, const std::filesystem::path& to);

/// The file that stands where a folder must be, on the way to `folder` or there; empty: none does.
std::filesystem::path file_in_the_way(const std::filesystem::path& folder);

/// What an error says of the disk that `folder` lies on: "0 bytes are free on /mnt/usb", and what to do. `folder` need
/// not exist.
std::string space_advice(const std::filesystem::path& folder);

/// Removes the temporary files in `folder` whose writer was killed. Files of living writers stay. Never throws.
void remove_stale_temporaries(const std::filesystem::path& folder);

/// Holds the run folder for this process until destroyed; the system lets go of it too when the process dies.
class FolderLock {
 public:
  /// Makes the folder if absent. Error(Fault::usage) that names the holder's process id when the folder is held.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  std::filesystem::path path_;
  int file_ = -1;
};

}  // namespace cloam
