// The bounds-checked byte reader that every binary format goes through, and the whole-file read that feeds it.
// Nothing here trusts a length that comes from a file: reading past the end is Fault::data with the byte offset.
#pragma once
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cloam {

/// The size of a regular file in bytes. Fault::data if there is none.
std::uint64_t file_bytes(const std::filesystem::path& path);

/// The bytes of a regular file. Fault::data if it cannot be read or holds more than `largest` bytes.
std::vector<std::uint8_t> read_file(const std::filesystem::path& path, std::uint64_t largest);

/// What a file that is of another kind than its name says most often is, by its first bytes, and what to do: "; it is a
/// ZIP archive: unpack it"; "" for others.
std::string other_kind(std::string_view beginning);

/// The number that begins there, little-endian as stored (every host that we build for is little-endian).
template <class Number>
Number number_at(const std::uint8_t* bytes) {
  Number value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

/// Walks over bytes it does not own. `name` (a file name) stands at the head of each error.
class ByteReader {
 public:
  ByteReader(std::span<const std::uint8_t> bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}

  std::size_t offset() const { return offset_; }
  std::size_t remaining() const { return bytes_.size() - offset_; }

  /// The next `count` bytes, still owned by the caller's buffer. Fault::data past the end.
  std::span<const std::uint8_t> take(std::uint64_t count, const char* what);
  void skip(std::uint64_t count, const char* what) { take(count, what); }

  /// The next number, little-endian.
  template <class Number>
  Number little(const char* what) {
    return number_at<Number>(take(sizeof(Number), what).data());
  }

  /// The next unsigned number of `size` (1 to 8) bytes, most significant byte first.
  std::uint64_t big(int size, const char* what);

  /// The bytes up to the next zero byte, which is skipped. Fault::data if none comes within `longest` bytes.
  std::string zero_ended(std::size_t longest, const char* what);

 private:
  std::span<const std::uint8_t> bytes_;
  std::string name_;
  std::size_t offset_ = 0;
};

}  // namespace cloam
