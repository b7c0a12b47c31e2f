// Zip files (PKWARE's APPNOTE.TXT): a directory at the end of the file says where each member lies.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace cloam {

/// Does it begin as a zip file does?
bool is_zip(std::span<const std::uint8_t> bytes);

struct ZipEntry {
  std::string name;
  std::uint16_t flags = 0, method = 0;
  std::uint32_t checksum = 0, packed = 0, content = 0, offset = 0;
};

/// A zip file in memory, which must outlive it; `name` stands at the head of errors, which are all Fault::data. Members
/// are stored or deflated; those that need zip64, encryption and other methods are refused. Sizes are checked against
/// the file before memory is asked for, contents against their checksums.
class Zip {
 public:
  using Bytes = std::span<const std::uint8_t>;
  Zip(Bytes bytes, std::string name) : bytes_(bytes), name_(std::move(name)), entries_(directory()) {}

  const std::string& name() const { return name_; }
  std::uint64_t size() const { return bytes_.size(); }
  const std::vector<ZipEntry>& entries() const { return entries_; }
  std::vector<std::uint8_t> content(const ZipEntry& entry) const;
  /// Of a member that is not deflated, where it lies in the file.
  Bytes stored(const ZipEntry& entry) const;

 private:
  [[noreturn]] void fail(const std::string& why) const;
  Bytes end_record() const;
  std::vector<ZipEntry> directory() const;
  void need_readable(const ZipEntry& entry) const;
  Bytes packed(const ZipEntry& entry) const;
  Bytes checked(const ZipEntry& entry, Bytes content) const;
  Bytes bytes_;
  std::string name_;
  std::vector<ZipEntry> entries_;
};

}  // namespace cloam
