// What is computed once from a capture's files and used by every later program: one file an entry, in a folder that
// programs may share and that may be deleted at any time. An entry's name says what it was computed from, by content,
// so none is ever out of date; what cannot be read or written is computed anew.
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/io/sha256.h"

namespace cloam {

/// All that an entry depends on.
class CacheKey {
 public:
  /// kind: what is computed, and the version of how: "sweep-1".
  explicit CacheKey(std::string kind) : kind_(std::move(kind)) {}
  CacheKey& add(std::string_view words);
  template <class Number>
  requires std::is_arithmetic_v<Number> CacheKey& add(Number number) {
    return add(std::string_view(reinterpret_cast<const char*>(&number), sizeof number));
  }
  template <class Scalar, int Rows, int Columns>
  CacheKey& add(const Eigen::Matrix<Scalar, Rows, Columns>& matrix) {
    for (const Scalar number : matrix.reshaped()) add(number);
    return *this;
  }
  /// The bytes of a file. Fault::data if it cannot be read.
  CacheKey& add_file(const std::filesystem::path& path) { return add(sha256_of_file(path)); }
  /// "KIND-" and the SHA-256 of all. Ends the key: nothing can be added after it.
  std::string name();

 private:
  std::string kind_;
  Sha256 hash_;
};

/// $CLOAM_DATA_CACHE, or data/ in the folder of the other caches ($CLOAM_CACHE_DIR, $XDG_CACHE_HOME/cloam or
/// ~/.cache/cloam); empty: CLOAM_DATA_CACHE=off.
std::filesystem::path data_cache_folder();

/// The bytes of an entry; none if it is not there, or damaged. Its time of change becomes now: the old ones are those
/// that nobody used.
std::optional<std::vector<std::uint8_t>> find_kept(const std::string& name);
/// Nothing happens where it cannot be written, or where there is a sound one.
void keep(const std::string& name, std::span<const std::uint8_t> bytes);

/// What the folder holds now.
struct KeptData {
  std::uint64_t files = 0, bytes = 0;
};
KeptData kept_data();

}  // namespace cloam
