// See bytes.h.
#include "models/io/bytes.h"

#include <algorithm>
#include <cerrno>
#include <fstream>

#include "models/io/paths.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kLongestMark = 32;  // by which a kind of file is known

[[noreturn]] void refuse(const std::filesystem::path& path, std::string why) {
  why[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(why[0])));  // "Permission denied", in a sentence
  bad_data(path.string(), ": ", why);
}

}  // namespace

std::uint64_t file_bytes(const std::filesystem::path& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) refuse(path, "no such file" + did_you_mean_path(path));
  if (!fs::status_known(status)) refuse(path, error.message());
  if (fs::is_directory(status)) refuse(path, "is a folder, not a file");
  // A pipe or device has no size and may never end.
  if (!fs::is_regular_file(status)) refuse(path, "is not a regular file (it is a device, a pipe or a socket)");
  const std::uint64_t size = fs::file_size(path, error);
  if (error) refuse(path, error.message());
  return size;
}

std::vector<std::uint8_t> read_file(const std::filesystem::path& path, std::uint64_t largest) {
  const std::uint64_t size = file_bytes(path);
  if (size > largest) bad_data(path.string(), ": holds ", size, " bytes, the limit is ", largest);
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) refuse(path, errno != 0 ? std::generic_category().message(errno) : "cannot be opened");
  std::vector<std::uint8_t> bytes(size);
  errno = 0;
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!file || static_cast<std::uint64_t>(file.gcount()) != size) {
    refuse(path, errno != 0 ? std::generic_category().message(errno) : "changed while it was read");
  }
  return bytes;
}

std::string other_kind(std::string_view beginning) {
  beginning.remove_prefix(std::min(beginning.find_first_not_of(" \t\r\n"), beginning.size()));
  const std::string first = lower_case(std::string(beginning.substr(0, kLongestMark)));
  if (first.starts_with("<!doctype html") || first.starts_with("<html"))
    return "; it is a web page: the download gave that instead of the file; download it again";
  if (first.starts_with("version https://git-lfs"))
    return "; it is a pointer of Git LFS: git lfs pull fetches the file itself";
  if (first.starts_with("pk\x03\x04")) return "; it is a ZIP archive: unpack it";
  if (first.starts_with("\x1f\x8b")) return "; it is packed with gzip: unpack it";
  return "";
}

std::span<const std::uint8_t> ByteReader::take(std::uint64_t count, const char* what) {
  if (count > remaining())
    bad_data(name_, ": ends in the middle of ", what, ": ", count, " bytes wanted at byte ", offset_, ", ", remaining(),
             " left; the file is damaged or truncated: copy it again");
  const auto part = bytes_.subspan(offset_, count);
  offset_ += count;
  return part;
}

std::uint64_t ByteReader::big(int size, const char* what) {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : take(size, what)) value = value << 8 | byte;
  return value;
}

std::string ByteReader::zero_ended(std::size_t longest, const char* what) {
  const auto rest = bytes_.subspan(offset_, std::min(longest + 1, remaining()));
  const auto end = std::find(rest.begin(), rest.end(), std::uint8_t{0});
  if (end == rest.end()) bad_data(name_, ": no end of ", what, " within ", rest.size(), " bytes of byte ", offset_);
  const std::string found(rest.begin(), end);
  offset_ += found.size() + 1;
  return found;
}

}  // namespace cloam
