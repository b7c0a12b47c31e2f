// See data_cache.h. A file: "CLOAMKPT", CRC-32C of the bytes, the bytes.
#include "models/io/data_cache.h"

#include <array>
#include <cstdlib>
#include <cstring>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/crc32c.h"
#include "runtime/cache_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kKeptMagic[] = "CLOAMKPT";
constexpr std::size_t kKeptHead = 8 + sizeof(uint32_t);
constexpr std::uint64_t kLargestKept = std::uint64_t{1} << 30;

}  // namespace

CacheKey& CacheKey::add(std::string_view words) {
  // With its length: "ab" and "c" are not "a" and "bc".
  const std::uint64_t length = words.size();
  hash_.add({reinterpret_cast<const std::uint8_t*>(&length), sizeof length});
  hash_.add({reinterpret_cast<const std::uint8_t*>(words.data()), words.size()});
  return *this;
}

std::string CacheKey::name() { return kind_ + "-" + hash_.digits(); }

fs::path data_cache_folder() {
  const char* own = std::getenv("CLOAM_DATA_CACHE");
  if (own && std::string_view(own) == "off") return {};
  return own && *own ? fs::path(own) : fs::path(cache_folder()) / "data";
}

std::optional<std::vector<std::uint8_t>> find_kept(const std::string& name) {
  const fs::path folder = data_cache_folder(), path = folder / name;
  std::error_code error;
  if (folder.empty() || !fs::is_regular_file(path, error)) return std::nullopt;
  try {
    std::vector<std::uint8_t> bytes = read_file(path, kLargestKept);
    if (bytes.size() < kKeptHead || std::memcmp(bytes.data(), kKeptMagic, 8) != 0) return std::nullopt;
    const auto sum = number_at<uint32_t>(bytes.data() + 8);
    bytes.erase(bytes.begin(), bytes.begin() + kKeptHead);
    if (crc32c(std::as_bytes(std::span(bytes))) != sum) return std::nullopt;
    fs::last_write_time(path, fs::file_time_type::clock::now(), error);
    return bytes;
  } catch (const Error&) { return std::nullopt; }
}

void keep(const std::string& name, std::span<const std::uint8_t> bytes) {
  const fs::path folder = data_cache_folder();
  if (folder.empty()) return;
  const uint32_t sum = crc32c(std::as_bytes(bytes));
  const std::array<std::span<const std::byte>, 3> parts = {std::as_bytes(std::span(kKeptMagic, 8)),
                                                           std::as_bytes(std::span(&sum, 1)), std::as_bytes(bytes)};
  try {
    commit_bytes(folder / name, parts);
  } catch (const Error&) {}  // it is computed again
}

KeptData kept_data() {
  KeptData all;
  std::error_code error;
  for (fs::directory_iterator entry(data_cache_folder(), error), end; !error && entry != end; entry.increment(error)) {
    std::error_code gone;
    const auto bytes = fs::file_size(entry->path(), gone);
    if (gone) continue;
    ++all.files;
    all.bytes += bytes;
  }
  return all;
}

}  // namespace cloam
