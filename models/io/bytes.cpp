// See bytes.h.
#include "models/io/bytes.h"

#include <algorithm>
#include <fstream>

#include "runtime/error.h"

namespace cloam {

std::uint64_t file_bytes(const std::filesystem::path& path) {
  std::error_code error;
  // A pipe or device has no size and may never end.
  if (!std::filesystem::is_regular_file(path, error)) {
    throw Error(Fault::data, text(path.string(), ": no such file (or a folder, or a device)"));
  }
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error) throw Error(Fault::data, text(path.string(), ": its size cannot be read: ", error.message()));
  return size;
}

std::vector<std::uint8_t> read_file(const std::filesystem::path& path, std::uint64_t largest) {
  const std::uint64_t size = file_bytes(path);
  if (size > largest) {
    throw Error(Fault::data, text(path.string(), ": holds ", size, " bytes, the most that is read is ", largest));
  }
  std::ifstream file(path, std::ios::binary);
  std::vector<std::uint8_t> bytes(size);
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!file || static_cast<std::uint64_t>(file.gcount()) != size) {
    throw Error(Fault::data, text(path.string(), ": cannot be read: may the user read it, is the disk sound?"));
  }
  return bytes;
}

std::span<const std::uint8_t> ByteReader::take(std::uint64_t count, const char* what) {
  if (count > remaining()) {
    throw Error(Fault::data, text(name_, ": ends in the middle of ", what, ": ", count, " bytes wanted at byte ",
                                  offset_, ", ", remaining(), " left; the file is damaged or cut short"));
  }
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
  if (end == rest.end()) {
    throw Error(Fault::data, text(name_, ": no end of ", what, " within ", rest.size(), " bytes of byte ", offset_));
  }
  const std::string found(rest.begin(), end);
  offset_ += found.size() + 1;
  return found;
}

}  // namespace cloam
