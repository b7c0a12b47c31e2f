// See zip.h.
#include "models/io/zip.h"

#include <zlib.h>

#include <algorithm>

#include "models/io/bytes.h"
#include "models/io/gzip.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kEndBytes = 22, kLongestComment = 65535;
constexpr std::uint32_t kEndMark = 0x06054b50, kEntryMark = 0x02014b50, kMemberMark = 0x04034b50;
constexpr std::uint32_t kIn64 = 0xffffffff;  // the true number is in a zip64 record

ZipEntry next_entry(ByteReader& reader, const std::string& file) {
  if (reader.little<std::uint32_t>("the directory") != kEntryMark)
    bad_data(file, ": its zip directory is damaged; copy it again");
  ZipEntry entry;
  reader.skip(4, "the directory");
  entry.flags = reader.little<std::uint16_t>("the directory");
  entry.method = reader.little<std::uint16_t>("the directory");
  reader.skip(4, "the directory");
  entry.checksum = reader.little<std::uint32_t>("the directory");
  entry.packed = reader.little<std::uint32_t>("the directory");
  entry.content = reader.little<std::uint32_t>("the directory");
  const auto name = reader.little<std::uint16_t>("the directory"),
             extra = reader.little<std::uint16_t>("the directory"),
             comment = reader.little<std::uint16_t>("the directory");
  reader.skip(8, "the directory");
  entry.offset = reader.little<std::uint32_t>("the directory");
  const auto letters = reader.take(name, "a member's name");
  entry.name.assign(letters.begin(), letters.end());
  reader.skip(std::uint64_t{extra} + comment, "the directory");
  return entry;
}

}  // namespace

bool is_zip(std::span<const std::uint8_t> bytes) {
  constexpr std::uint8_t kZipStart[] = {'P', 'K', 3, 4};
  return bytes.size() >= 4 && std::equal(std::begin(kZipStart), std::end(kZipStart), bytes.begin());
}

void Zip::fail(const std::string& why) const { bad_data(name_, ": ", why); }

/// The last record of the file; only a comment may follow it.
Zip::Bytes Zip::end_record() const {
  const std::size_t most = std::min(bytes_.size(), kEndBytes + kLongestComment);
  for (std::size_t back = kEndBytes; back <= most; back++) {
    ByteReader reader(bytes_.subspan(bytes_.size() - back), name_);
    if (reader.little<std::uint32_t>("the end record") == kEndMark) return bytes_.subspan(bytes_.size() - back);
  }
  fail("no directory at its end: it is not a zip file, or is truncated; copy it again");
}

std::vector<ZipEntry> Zip::directory() const {
  ByteReader end(end_record(), name_);
  end.skip(10, "the end record");
  const auto count = end.little<std::uint16_t>("the end record");
  const auto size = end.little<std::uint32_t>("the end record"), offset = end.little<std::uint32_t>("the end record");
  if (offset > bytes_.size() || size > bytes_.size() - offset)
    fail("its directory lies outside the file (zip64 is not read)");
  ByteReader reader(bytes_.subspan(offset, size), name_);
  std::vector<ZipEntry> entries;
  std::uint64_t content = 0;
  for (int i = 0; i < count; i++) {
    entries.push_back(next_entry(reader, name_));
    content += entries.back().content;
  }
  if (content > most_unpacked(bytes_.size()))
    fail(text(bytes_.size(), " bytes that unpack to ", content,
              " are refused: want 16 MB, or at most 200 times the file"));
  return entries;
}

/// The member's bytes as they lie in the file, behind a second header whose sizes may be missing.
Zip::Bytes Zip::packed(const ZipEntry& entry) const {
  if (entry.offset > bytes_.size()) fail(text("member ", printable(entry.name), " lies beyond the end of the file"));
  ByteReader reader(bytes_.subspan(entry.offset), name_);
  if (reader.little<std::uint32_t>("a member") != kMemberMark)
    fail(text("member ", printable(entry.name), " is not where the directory says; the file is damaged"));
  reader.skip(22, "a member");
  const auto name = reader.little<std::uint16_t>("a member"), extra = reader.little<std::uint16_t>("a member");
  reader.skip(std::uint64_t{name} + extra, "a member");
  return reader.take(entry.packed, "a member");
}

Zip::Bytes Zip::checked(const ZipEntry& entry, Bytes content) const {
  if (crc32_z(0, content.data(), content.size()) != entry.checksum)
    fail(text("member ", printable(entry.name), ": its checksum does not match: the file is damaged; copy it again"));
  return content;
}

void Zip::need_readable(const ZipEntry& entry) const {
  const bool known = entry.method == 0 || entry.method == Z_DEFLATED;
  if ((entry.flags & 1) != 0 || !known || entry.packed == kIn64 || entry.content == kIn64)
    fail(text("member ", printable(entry.name), " is encrypted, larger than 4 GB, or packed by method ", entry.method,
              "; want stored or deflated: save it with numpy.savez or torch.save"));
}

Zip::Bytes Zip::stored(const ZipEntry& entry) const {
  need_readable(entry);
  const Bytes from = packed(entry);
  if (entry.method != 0 || entry.content != from.size())
    fail(text("member ", printable(entry.name), " cannot hold ", entry.content, " bytes in ", from.size(),
              " that are not deflated"));
  return checked(entry, from);
}

std::vector<std::uint8_t> Zip::content(const ZipEntry& entry) const {
  need_readable(entry);
  if (entry.method == 0) {
    const Bytes whole = stored(entry);
    return {whole.begin(), whole.end()};
  }
  std::vector<std::uint8_t> result(entry.content);
  if (!inflate_exactly(packed(entry), result))
    fail(text("member ", printable(entry.name), " does not unpack to ", entry.content, " bytes"));
  checked(entry, result);
  return result;
}

}  // namespace cloam
