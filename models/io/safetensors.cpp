// The checks follow tensor.rs of the reference (offsets cover the data without hole or overlap, checked products,
// unique names, header of at most 100 MB) and add ours: exact keys, no NUL bytes, checksums, regular files only.
#include "models/io/safetensors.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <span>
#include <string_view>

#include "models/io/commit.h"
#include "models/io/crc32c.h"
#include "models/io/safetensors_header.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxHeaderBytes = 100'000'000;
constexpr std::string_view kMetadataKey = "__metadata__";
constexpr std::string_view kChecksumKey = "crc32c";
constexpr std::string_view kTensorChecksumPrefix = "crc32c.";
// The header's own checksum stands at this fixed place; it is computed with these eight digits in its stead.
constexpr std::string_view kSealStart = R"({"__metadata__":{"crc32c":")";
constexpr std::string_view kBlankSeal = "00000000";

/// A regular file read by position. No memory map: a file cut short under a map kills the process.
class InputFile {
 public:
  explicit InputFile(const fs::path& path) : path_(path) {
    file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file_ < 0) bad_data("cannot open ", path.string(), ": ", std::strerror(errno));
    struct stat status {};
    if (::fstat(file_, &status) != 0 || !S_ISREG(status.st_mode)) {
      ::close(file_);
      bad_data(path.string(), " is not a regular file; want a safetensors file");
    }
    size_ = static_cast<uint64_t>(status.st_size);
  }
  ~InputFile() { ::close(file_); }
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  uint64_t size() const { return size_; }

  void read(uint64_t offset, std::span<std::byte> bytes) const {
    while (!bytes.empty()) {
      const ssize_t count = ::pread(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) fail(offset, count < 0 ? std::strerror(errno) : "the file shrank while it was being read");
      bytes = bytes.subspan(static_cast<size_t>(count));
      offset += static_cast<uint64_t>(count);
    }
  }

  [[noreturn]] void fail(uint64_t offset, const std::string& problem) const {
    bad_data(path_.string(), ": byte ", offset, ": ", problem);
  }

 private:
  fs::path path_;
  int file_ = -1;
  uint64_t size_ = 0;
};

std::string header_checksum(std::string header) {
  header.replace(kSealStart.size(), kBlankSeal.size(), kBlankSeal);
  return crc32c_digits(crc32c(std::as_bytes(std::span(header))));
}

bool is_sealed(const std::string& header) {
  return header.starts_with(kSealStart) && header.size() >= kSealStart.size() + kBlankSeal.size();
}

std::string read_header(const InputFile& file) {
  if (file.size() < 8) file.fail(0, text("need 8 bytes of header length, the file has ", file.size()));
  uint64_t length = 0;
  file.read(0, std::as_writable_bytes(std::span(&length, 1)));
  if (length > kMaxHeaderBytes) file.fail(0, text("header of ", length, " bytes; at most 100000000 are allowed"));
  if (length > file.size() - 8) {
    file.fail(0, text("header of ", length, " bytes, but the file has only ", file.size() - 8, " more"));
  }
  std::string header(length, '\0');
  file.read(8, std::as_writable_bytes(std::span(header)));
  if (header.empty() || header[0] != '{')
    file.fail(8, "the header must begin with '{'; this is not a safetensors file");
  // The JSON library takes NUL for the end of its input, which would hide what follows.
  if (const size_t nul = header.find('\0'); nul != std::string::npos) file.fail(8 + nul, "NUL byte in the header");
  if (is_sealed(header) && header.substr(kSealStart.size(), kBlankSeal.size()) != header_checksum(header)) {
    file.fail(8, "the header's checksum does not match: the file is damaged");
  }
  return header;
}

/// Bytes of a tensor; throws the problem as text.
uint64_t declared_bytes(const SafetensorsEntry& entry) {
  const uint64_t width = dtype_bytes(entry.dtype);
  if (width == 0) bad_data("unknown dtype '", printable(entry.dtype), "'");
  uint64_t bytes = width;
  for (const int64_t extent : entry.shape) {
    if (extent < 0 || __builtin_mul_overflow(bytes, static_cast<uint64_t>(extent), &bytes))
      bad_data("shape ", shape_text(entry.shape), " is more than 2^64 bytes");
  }
  return bytes;
}

void check_entry(const SafetensorsEntry& entry, uint64_t expected_begin, uint64_t available) {
  if (entry.begin != expected_begin)
    bad_data("data begins at ", entry.begin, " of the data section, but the tensor before ends at ", expected_begin,
             ": ", entry.begin < expected_begin ? "overlap" : "hole");
  if (entry.end < entry.begin || entry.end > available)
    bad_data("data_offsets [", entry.begin, ",", entry.end, "] leave the data section of ", available, " bytes");
  if (const uint64_t bytes = declared_bytes(entry); bytes != entry.end - entry.begin)
    bad_data(entry.dtype, " ", shape_text(entry.shape), " needs ", bytes, " bytes, data_offsets give ",
             entry.end - entry.begin);
}

/// The data section must be covered from its first to its last byte, each byte once.
void check_layout(const InputFile& file, const SafetensorsHeader& header, uint64_t data_start) {
  std::vector<const std::pair<const std::string, SafetensorsEntry>*> order;
  for (const auto& item : header.entries) order.push_back(&item);
  std::stable_sort(order.begin(), order.end(), [](const auto* a, const auto* b) {
    return std::pair(a->second.begin, a->second.end) < std::pair(b->second.begin, b->second.end);
  });
  uint64_t covered = 0;
  for (const auto* item : order) {
    try {
      check_entry(item->second, covered, file.size() - data_start);
    } catch (const Error& problem) {
      file.fail(data_start + covered, text("tensor '", printable(item->first), "': ", problem.what()));
    }
    covered = item->second.end;
  }
  if (data_start + covered != file.size()) {
    file.fail(data_start + covered, text(file.size() - data_start - covered, " bytes after the last tensor"));
  }
}

/// Takes the checksums out of the metadata: tensor name -> digits. A sealed file has one for every tensor, no more.
std::map<std::string, std::string> take_checksums(const InputFile& file, SafetensorsHeader& header, bool sealed) {
  std::map<std::string, std::string> checksums;
  std::erase_if(header.metadata, [&](const auto& item) {
    if (!item.first.starts_with(kTensorChecksumPrefix)) return item.first == kChecksumKey;
    checksums[item.first.substr(kTensorChecksumPrefix.size())] = item.second;
    return true;
  });
  for (const auto& [name, digits] : checksums) {
    if (!header.entries.contains(name)) file.fail(8, text("checksum for a missing tensor '", printable(name), "'"));
  }
  if (!checksums.empty() && !sealed)
    file.fail(8, "tensors have checksums but the header has none: the file is damaged");
  for (const auto& [name, entry] : header.entries) {
    if (sealed && !checksums.contains(name)) file.fail(8, text("tensor '", printable(name), "' has no checksum"));
  }
  return checksums;
}

/// A file whose header and layout were found right; each tensor is checked when it is read.
class CheckedFile {
 public:
  explicit CheckedFile(const fs::path& path) : file_(path) {
    const std::string text = read_header(file_);
    data_start_ = 8 + text.size();
    try {
      header_ = parse_safetensors_header(text);
    } catch (const Error& problem) { file_.fail(8, problem.what()); }
    check_layout(file_, header_, data_start_);
    checksums_ = take_checksums(file_, header_, is_sealed(text));
  }
  const std::map<std::string, SafetensorsEntry>& entries() const { return header_.entries; }
  const std::map<std::string, std::string>& metadata() const { return header_.metadata; }

  NamedTensor tensor(const std::string& name, const SafetensorsEntry& entry) const {
    NamedTensor out{entry.dtype, entry.shape, std::vector<std::byte>(entry.end - entry.begin)};
    file_.read(data_start_ + entry.begin, out.data);
    const auto want = checksums_.find(name);
    if (want == checksums_.end()) return out;
    if (const std::string found = crc32c_digits(crc32c(out.data)); found != want->second)
      file_.fail(data_start_ + entry.begin, text("tensor '", printable(name), "': checksum is ", found, ", want ",
                                                 printable(want->second), ": the data is damaged"));
    return out;
  }

 private:
  InputFile file_;
  uint64_t data_start_ = 0;
  SafetensorsHeader header_;
  std::map<std::string, std::string> checksums_;
};

template <class Word>
bool all_finite(std::span<const std::byte> data, Word exponent_mask) {
  for (size_t i = 0; i + sizeof(Word) <= data.size(); i += sizeof(Word)) {
    Word word = 0;
    std::memcpy(&word, data.data() + i, sizeof(Word));
    if ((word & exponent_mask) == exponent_mask) return false;
  }
  return true;
}

void check_saveable(const std::string& name, const NamedTensor& tensor) {
  if (name == kMetadataKey) throw Error(Fault::internal, "a tensor cannot be named __metadata__");
  const SafetensorsEntry entry{tensor.dtype, tensor.shape, 0, tensor.data.size()};
  if (const uint64_t bytes = declared_bytes(entry); bytes != tensor.data.size()) {
    throw Error(Fault::internal, text("tensor '", name, "': ", tensor.dtype, " ", shape_text(tensor.shape), " needs ",
                                      bytes, " bytes, got ", tensor.data.size()));
  }
  const bool finite = tensor.dtype == "F32"   ? all_finite<uint32_t>(tensor.data, 0x7f800000)
                      : tensor.dtype == "F16" ? all_finite<uint16_t>(tensor.data, 0x7c00)
                                              : true;
  if (!finite) {
    throw Error(Fault::diverged, text("tensor '", name, "' holds NaN or infinite values and is not saved; ",
                                      "the last good checkpoint stays"));
  }
}

std::string sealed_header(const SafetensorsFile& file) {
  std::map<std::string, std::string> metadata = file.metadata;
  std::map<std::string, SafetensorsEntry> entries;
  uint64_t begin = 0;
  for (const auto& [name, tensor] : file.tensors) {
    metadata[std::string(kTensorChecksumPrefix) + name] = crc32c_digits(crc32c(tensor.data));
    entries[name] = {tensor.dtype, tensor.shape, begin, begin + tensor.data.size()};
    begin += tensor.data.size();
  }
  std::string header = text(kSealStart, kBlankSeal, '"');
  for (const auto& [key, value] : metadata) header += text(',', json_string(key), ':', json_string(value));
  header += '}';
  for (const auto& [name, entry] : entries) header += text(',', json_string(name), ':', json_text(entry));
  header += '}';
  header.append((8 - header.size() % 8) % 8, ' ');
  header.replace(kSealStart.size(), kBlankSeal.size(), header_checksum(header));
  return header;
}

}  // namespace

void write_safetensors(const fs::path& path, const SafetensorsFile& file) {
  for (const auto& [name, tensor] : file.tensors) check_saveable(name, tensor);
  for (const auto& [key, value] : file.metadata) {
    if (key.starts_with(kChecksumKey)) throw Error(Fault::internal, text("metadata name '", key, "' is reserved"));
  }
  const std::string header = sealed_header(file);
  const uint64_t length = header.size();
  std::vector<std::span<const std::byte>> parts{std::as_bytes(std::span(&length, 1)), std::as_bytes(std::span(header))};
  for (const auto& [name, tensor] : file.tensors) parts.emplace_back(tensor.data);
  commit_bytes(path, parts);
}

SafetensorsFile read_safetensors(const fs::path& path) {
  const CheckedFile file(path);
  SafetensorsFile result{{}, file.metadata()};
  for (const auto& [name, entry] : file.entries()) result.tensors.emplace(name, file.tensor(name, entry));
  return result;
}

bool reads_back(const fs::path& path, const SafetensorsFile& file) {
  const CheckedFile written(path);
  return written.metadata() == file.metadata && written.entries().size() == file.tensors.size() &&
         std::ranges::all_of(written.entries(), [&](const auto& item) {
           const auto kept = file.tensors.find(item.first);
           return kept != file.tensors.end() && written.tensor(item.first, item.second) == kept->second;
         });
}

}  // namespace cloam
