// See npz.h. The zip format is PKWARE's APPNOTE.TXT: a directory at the end of the file says where each member lies.
#include "models/io/npz.h"

#include <zlib.h>

#include <algorithm>

#include "models/io/bytes.h"
#include "models/io/gzip.h"
#include "models/io/npy.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kLargestFile = std::uint64_t{2} << 30;
constexpr std::uint64_t kAlwaysAllowed = std::uint64_t{16} << 20;  // of content, all members together
constexpr std::uint64_t kMaxRatio = 200;                           // beyond that; as in gzip.cpp
constexpr std::size_t kEndBytes = 22, kLongestComment = 65535;
constexpr std::uint32_t kEndMark = 0x06054b50, kEntryMark = 0x02014b50, kMemberMark = 0x04034b50;
constexpr std::uint32_t kIn64 = 0xffffffff;  // the true number is in a zip64 record

struct Entry {
  std::string name;
  std::uint16_t flags = 0, method = 0;
  std::uint32_t checksum = 0, packed = 0, content = 0, offset = 0;
};

using Bytes = std::span<const std::uint8_t>;

class Zip {
 public:
  Zip(Bytes bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}
  std::vector<Entry> directory() const;
  std::vector<std::uint8_t> content(const Entry& entry) const;

 private:
  [[noreturn]] void fail(const std::string& why) const { bad_data(name_, ": ", why); }
  Bytes end_record() const;
  Entry next_entry(ByteReader& reader) const;
  Bytes packed(const Entry& entry) const;
  Bytes bytes_;
  std::string name_;
};

/// The last record of the file; only a comment may follow it.
Bytes Zip::end_record() const {
  const std::size_t most = std::min(bytes_.size(), kEndBytes + kLongestComment);
  for (std::size_t back = kEndBytes; back <= most; back++) {
    ByteReader reader(bytes_.subspan(bytes_.size() - back), name_);
    if (reader.little<std::uint32_t>("the end record") == kEndMark) return bytes_.subspan(bytes_.size() - back);
  }
  fail("no directory at its end: it is not a zip file, or is truncated; copy it again");
}

Entry Zip::next_entry(ByteReader& reader) const {
  if (reader.little<std::uint32_t>("the directory") != kEntryMark) fail("its zip directory is damaged; copy it again");
  Entry entry;
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
  const Bytes letters = reader.take(name, "a member's name");
  entry.name.assign(letters.begin(), letters.end());
  reader.skip(std::uint64_t{extra} + comment, "the directory");
  return entry;
}

std::vector<Entry> Zip::directory() const {
  ByteReader end(end_record(), name_);
  end.skip(10, "the end record");
  const auto count = end.little<std::uint16_t>("the end record");
  const auto size = end.little<std::uint32_t>("the end record"), offset = end.little<std::uint32_t>("the end record");
  if (offset > bytes_.size() || size > bytes_.size() - offset)
    fail("its directory lies outside the file (zip64 is not read)");
  ByteReader reader(bytes_.subspan(offset, size), name_);
  std::vector<Entry> entries;
  std::uint64_t content = 0;
  for (int i = 0; i < count; i++) {
    entries.push_back(next_entry(reader));
    content += entries.back().content;
  }
  if (content > std::max(kAlwaysAllowed, kMaxRatio * bytes_.size()))
    fail(text(bytes_.size(), " bytes that unpack to ", content,
              " are refused: want 16 MB, or at most 200 times the file"));
  return entries;
}

/// The member's bytes as they lie in the file, behind a second header whose sizes may be missing.
Bytes Zip::packed(const Entry& entry) const {
  if (entry.offset > bytes_.size()) fail(text("member ", printable(entry.name), " lies beyond the end of the file"));
  ByteReader reader(bytes_.subspan(entry.offset), name_);
  if (reader.little<std::uint32_t>("a member") != kMemberMark)
    fail(text("member ", printable(entry.name), " is not where the directory says; the file is damaged"));
  reader.skip(22, "a member");
  const auto name = reader.little<std::uint16_t>("a member"), extra = reader.little<std::uint16_t>("a member");
  reader.skip(std::uint64_t{name} + extra, "a member");
  return reader.take(entry.packed, "a member");
}

std::vector<std::uint8_t> Zip::content(const Entry& entry) const {
  const bool stored = entry.method == 0;
  if ((entry.flags & 1) != 0 || (!stored && entry.method != Z_DEFLATED) || entry.packed == kIn64 ||
      entry.content == kIn64)
    fail(text("member ", printable(entry.name), " is encrypted, larger than 4 GB, or packed by method ", entry.method,
              "; want stored or deflated: save it with numpy.savez"));
  const Bytes from = packed(entry);
  if (stored && entry.content != from.size())
    fail(text("member ", printable(entry.name), " cannot hold ", entry.content, " bytes in ", from.size()));
  std::vector<std::uint8_t> result(from.begin(), from.end());
  result.resize(entry.content);
  if (!stored && !inflate_exactly(from, result))
    fail(text("member ", printable(entry.name), " does not unpack to ", entry.content, " bytes"));
  if (crc32_z(0, result.data(), result.size()) != entry.checksum)
    fail(text("member ", printable(entry.name), ": its checksum does not match: the file is damaged; copy it again"));
  return result;
}

NamedTensor as_tensor(const NpyArray& array) {
  const std::vector<float> values = npy_floats(array);
  const auto bytes = std::as_bytes(std::span(values));
  return {"F32", {array.shape.begin(), array.shape.end()}, {bytes.begin(), bytes.end()}};
}

}  // namespace

bool is_zip(Bytes bytes) {
  constexpr std::uint8_t kStart[] = {'P', 'K', 3, 4};
  return bytes.size() >= 4 && std::equal(std::begin(kStart), std::end(kStart), bytes.begin());
}

TensorMap read_npz(const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, kLargestFile);
  const Zip zip(bytes, path.string());
  TensorMap all;
  for (const Entry& entry : zip.directory()) {
    const std::string label = text(path.string(), ": member ", printable(entry.name));
    if (!entry.name.ends_with(".npy")) bad_data(label, ": want only .npy members");
    const std::vector<std::uint8_t> content = zip.content(entry);
    const std::string name = entry.name.substr(0, entry.name.size() - 4);
    if (!all.emplace(name, as_tensor(parse_npy(content, label))).second) bad_data(label, ": appears twice");
  }
  return all;
}

}  // namespace cloam
