// See image_bytes.h.
#include "models/io/image_bytes.h"

#include <zlib.h>

#include <algorithm>
#include <string_view>

#include "models/io/bytes.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

// TGA has no magic number: plausible fields of its header must do.
bool looks_like_tga(const std::vector<std::uint8_t>& bytes) {
  if (bytes.size() < 18 || bytes[1] > 1) return false;
  const int kind = bytes[2] & ~8, depth = bytes[16];
  return kind >= 1 && kind <= 3 && (depth == 8 || depth == 15 || depth == 16 || depth == 24 || depth == 32);
}

// Chunks of length, name, data, CRC up to IEND. www.w3.org/TR/png, section 5
// libpng would find wrong CRCs too, but prints on its own besides.
void require_sound_png(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  ByteReader reader(bytes, path.string());
  reader.skip(8, "the PNG signature");
  for (std::uint64_t kind = 0; kind != 0x49454e44;) {  // "IEND"
    const auto length = reader.big(4, "a PNG chunk");
    const std::size_t start = reader.offset();
    kind = reader.big(4, "a PNG chunk");
    reader.skip(length, "a PNG chunk");
    const auto crc = crc32(0, bytes.data() + start, static_cast<unsigned>(length + 4));
    if (reader.big(4, "a PNG chunk") != crc)
      damaged_image(path, text("the checksum at byte ", reader.offset() - 4, " is wrong"));
  }
}

// Marker segments up to EOI. After a scan header come coded bytes, where ff is followed by 0 or a restart marker.
// ITU-T T.81, annex B
void require_complete_jpeg(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  ByteReader reader(bytes, path.string());
  reader.skip(2, "the JPEG signature");
  for (;;) {
    while (reader.big(1, "the JPEG picture data") != 0xff) {}
    int marker = 0xff;
    while (marker == 0xff) marker = static_cast<int>(reader.big(1, "a JPEG marker"));
    if (marker == 0xd9) return;
    const bool alone = marker == 0 || marker == 1 || (marker >= 0xd0 && marker <= 0xd8);
    if (alone) continue;
    const auto length = reader.big(2, "a JPEG segment");
    if (length < 2) damaged_image(path, text("a JPEG segment of length ", length, " at byte ", reader.offset()));
    reader.skip(length - 2, "a JPEG segment");
  }
}

/// What decides how many parts an EXR is stored in.
struct ExrHeader {
  std::int64_t width = 0, height = 0, tile_width = 0, tile_height = 0;
  int compression = 0;

  /// The least number: without the smaller copies that it may hold.
  std::int64_t parts() const {
    constexpr int lines[] = {1, 1, 1, 16, 32, 16, 32, 32, 32, 256};
    if (tile_width > 0 && tile_height > 0)
      return ((width + tile_width - 1) / tile_width) * ((height + tile_height - 1) / tile_height);
    const int together = compression < static_cast<int>(std::size(lines)) ? lines[compression] : 1;
    return (height + together - 1) / together;
  }
};

/// Attributes (name, kind, size, value) up to an empty name. False where there is no further header.
bool read_exr_header(ByteReader& reader, ExrHeader& header) {
  constexpr std::size_t longest = 255;
  std::string name = reader.zero_ended(longest, "an EXR attribute");
  if (name.empty()) return false;
  for (; !name.empty(); name = reader.zero_ended(longest, "an EXR attribute")) {
    reader.zero_ended(longest, "an EXR attribute");
    ByteReader value(reader.take(reader.little<std::uint32_t>("an EXR attribute"), "an EXR attribute"), "");
    if (name == "compression" && value.remaining() == 1) header.compression = value.little<std::uint8_t>("");
    if (name == "tiles" && value.remaining() == 9) {
      header.tile_width = value.little<std::uint32_t>("");
      header.tile_height = value.little<std::uint32_t>("");
    }
    if (name == "dataWindow" && value.remaining() == 16) {
      std::int64_t corners[4];
      for (std::int64_t& corner : corners) corner = value.little<std::int32_t>("");
      header.width = corners[2] - corners[0] + 1;
      header.height = corners[3] - corners[1] + 1;
    }
  }
  return true;
}

// The library makes room for a table of all parts before it can be asked for the size; the file must hold that table.
// openexr.com/en/latest/OpenEXRFileLayout.html
void require_sound_exr(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  constexpr std::uint32_t deep = 0x800, several = 0x1000;
  ByteReader reader(bytes, path.string());
  reader.skip(4, "the EXR signature");
  const auto version = reader.little<std::uint32_t>("the EXR version");
  if (version & deep) damaged_image(path, "deep EXR images, with several samples per pixel, are not supported");
  std::int64_t parts = 0;
  for (ExrHeader header; read_exr_header(reader, header); header = {}) {
    if (header.width < 1 || header.height < 1 || header.width > kLongestImageSide || header.height > kLongestImageSide)
      damaged_image(path, text("the header says ", header.width, "x", header.height, " pixels"));
    parts += header.parts();
    if (!(version & several)) break;
  }
  if (parts > static_cast<std::int64_t>(reader.remaining() / 8))
    damaged_image(path, text("the header declares ", parts, " parts, only ", reader.remaining(), " bytes follow"));
}

[[noreturn]] void no_image(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  const std::string want = path.string() + ": want a PNG, JPEG or EXR image, ",
                    again = "; copy it again, or use --skip-bad";
  if (bytes.empty()) bad_data(want, "the file is empty", again);
  if (std::all_of(bytes.begin(), bytes.end(), [](std::uint8_t byte) { return byte == 0; }))
    bad_data(want, "the file holds nothing but zeros", again);
  constexpr std::size_t beginning = 256;
  const std::string kind = other_kind({reinterpret_cast<const char*>(bytes.data()), std::min(bytes.size(), beginning)});
  bad_data(want, "found something else", kind.empty() ? again : kind);
}

}  // namespace

void damaged_image(const std::filesystem::path& path, const std::string& why) {
  bad_data(path.string(), ": damaged image: ", why, "; copy it again, or use --skip-bad");
}

bool starts_with(const std::vector<std::uint8_t>& bytes, std::string_view magic, std::size_t at) {
  return bytes.size() >= at + magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin() + at,
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

std::string format_of(const std::vector<std::uint8_t>& bytes) {
  using namespace std::string_view_literals;
  if (starts_with(bytes, "\x89PNG\r\n\x1a\n"sv)) return "png";
  if (starts_with(bytes, "\xff\xd8\xff"sv)) return "jpeg";
  if (starts_with(bytes, "\x76\x2f\x31\x01"sv)) return "openexr";
  if (starts_with(bytes, "GIF8"sv)) return "GIF";
  if (starts_with(bytes, "BM"sv)) return "BMP";
  if (starts_with(bytes, "II*\0"sv) || starts_with(bytes, "MM\0*"sv)) return "TIFF";
  if (starts_with(bytes, "WEBP"sv, 8)) return "WebP";
  if (starts_with(bytes, "ftyp"sv, 4)) return "HEIC, AVIF or video";
  if (starts_with(bytes, "#?"sv)) return "Radiance HDR";
  if (looks_like_tga(bytes)) return "TGA";
  return "unknown";
}

std::string format_of_name(const std::filesystem::path& path) {
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".png") return "png";
  if (extension == ".jpg" || extension == ".jpeg") return "jpeg";
  if (extension == ".exr") return "openexr";
  return extension;
}

void require_format(const std::filesystem::path& path, const std::string& format,
                    const std::vector<std::uint8_t>& bytes) {
  if (format == "unknown") no_image(path, bytes);
  if (format != "png" && format != "jpeg" && format != "openexr")
    bad_data(path.string(), ": want a PNG, JPEG or EXR image, the content is ", format,
             "; convert it (magick IN OUT.png)");
  const std::string named = format_of_name(path);
  if (!named.empty() && named != format)
    bad_data(path.string(), ": named as ", named, " but the content is ", format, "; rename it");
}

void require_sound_bytes(const std::filesystem::path& path, const std::string& format,
                         const std::vector<std::uint8_t>& bytes) {
  if (format == "png") require_sound_png(path, bytes);
  if (format == "jpeg") require_complete_jpeg(path, bytes);
  if (format == "openexr") require_sound_exr(path, bytes);
}

}  // namespace cloam
