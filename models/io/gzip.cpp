// See gzip.h.
#include "models/io/gzip.h"

#include <zlib.h>

#include <algorithm>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kGzipWindow = 15 + 16;  // zlib's way to ask for gzip's header
constexpr int kLevel = 6;
constexpr std::uint64_t kAlwaysAllowed = std::uint64_t{16} << 20;
constexpr std::uint64_t kMaxRatio = 200;
constexpr std::size_t kPiece = std::size_t{1} << 18;

[[noreturn]] void damaged(const std::string& name, std::size_t offset, const std::string& why) {
  bad_data(name, ": byte ", offset, " of the gzip stream: ", why, "; copy the file again");
}

class Inflater {
 public:
  explicit Inflater(std::span<const std::uint8_t> bytes, int window = kGzipWindow) : size_(bytes.size()) {
    stream_.next_in = const_cast<Bytef*>(bytes.data());
    stream_.avail_in = static_cast<uInt>(bytes.size());
    if (inflateInit2(&stream_, window) != Z_OK) throw Error(Fault::internal, "zlib failed to start");
  }
  ~Inflater() { inflateEnd(&stream_); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  /// Fills `piece` as far as the stream goes; the number of bytes written.
  std::size_t next(std::span<std::uint8_t> piece) {
    stream_.next_out = piece.data();
    stream_.avail_out = static_cast<uInt>(piece.size());
    code_ = inflate(&stream_, Z_NO_FLUSH);
    return piece.size() - stream_.avail_out;
  }

  bool ended() const { return code_ == Z_STREAM_END; }
  bool sound() const { return code_ == Z_OK || ended(); }
  std::string reason() const { return stream_.msg ? stream_.msg : "it is truncated"; }
  std::size_t offset() const { return size_ - stream_.avail_in; }

 private:
  z_stream stream_{};
  std::size_t size_;
  int code_ = Z_OK;
};

}  // namespace

bool is_gzip(std::span<const std::uint8_t> bytes) { return bytes.size() >= 2 && bytes[0] == 0x1f && bytes[1] == 0x8b; }

std::uint64_t most_unpacked(std::uint64_t packed) { return std::max(kAlwaysAllowed, kMaxRatio * packed); }

std::vector<std::uint8_t> gunzip(std::span<const std::uint8_t> bytes, std::uint64_t largest, const std::string& name) {
  if (bytes.size() >> 31) bad_data(name, ": more than 2 GB");
  const std::uint64_t most = std::min(largest, most_unpacked(bytes.size()));
  Inflater inflater(bytes);
  std::vector<std::uint8_t> result, piece(kPiece);
  while (!inflater.ended()) {
    const std::size_t count = inflater.next(piece);
    if (!inflater.sound()) damaged(name, inflater.offset(), inflater.reason());
    if (result.size() + count > most)
      bad_data(name, ": ", bytes.size(), " bytes of gzip hold more than ", most,
               " bytes, the most that is unpacked from that");
    result.insert(result.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(count));
  }
  if (inflater.offset() != bytes.size()) damaged(name, inflater.offset(), "more bytes follow its end");
  return result;
}

bool inflate_exactly(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> result) {
  Inflater inflater(bytes, -MAX_WBITS);
  return inflater.next(result) == result.size() && inflater.ended() && inflater.offset() == bytes.size();
}

std::vector<std::uint8_t> gzip(std::span<const std::uint8_t> bytes) {
  z_stream stream{};
  if (bytes.size() >> 31 || deflateInit2(&stream, kLevel, Z_DEFLATED, kGzipWindow, 8, Z_DEFAULT_STRATEGY) != Z_OK) {
    throw Error(Fault::internal, text("gzip of ", bytes.size(), " bytes"));
  }
  std::vector<std::uint8_t> result(deflateBound(&stream, bytes.size()));
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = result.data();
  stream.avail_out = static_cast<uInt>(result.size());
  const int code = deflate(&stream, Z_FINISH);
  result.resize(stream.total_out);
  deflateEnd(&stream);
  if (code != Z_STREAM_END) throw Error(Fault::internal, "gzip did not finish");
  return result;
}

}  // namespace cloam
