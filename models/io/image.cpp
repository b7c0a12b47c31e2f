// Images through OpenImageIO, opened only as the format that the content shows. The bytes are read once, walked to
// their end mark (a decoder may fill up a file that was cut short and say nothing), and decoded from memory.
#include "models/io/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <span>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/srgb.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t kMaxImageValues = std::uint64_t{1} << 29;
constexpr std::uint64_t kMaxImageBytes = std::uint64_t{1} << 31;
constexpr int kLongestSide = 1 << 17;
// What a header may promise, measured by the bytes that follow. Deflate shrinks to 1/1032 at best, JPEG to about that;
// of EXR's other compressions some write a block of equal pixels in a few bytes.
constexpr std::uint64_t kMaxShrunk = 1100, kMaxShrunkExr = 10000;
constexpr std::uint64_t kSmall = 16 << 20;         // bytes of pixels that nobody needs to ask about
constexpr std::uint64_t kMuch = 256 << 20;         // bytes as RGBA from which on a file must hold more than flat colour
constexpr std::uint64_t kMinShareOfMuch = 200;     // of these bytes to one of the file
constexpr std::uint64_t kLargestBlock = 64 << 20;  // bytes of one tile, or of the lines that are compressed together
constexpr std::size_t kPeeked = 64 << 10;          // bytes in which a header usually ends
constexpr std::uint64_t kAtOnce = 8 << 20;         // bytes of lines that are decoded in one call, if blocks are small

[[noreturn]] void damaged(const std::filesystem::path& path, const std::string& why) {
  bad_data(path.string(), ": damaged image: ", why, "; copy it again, or use --skip-bad");
}

bool starts_with(const Bytes& bytes, std::string_view magic, std::size_t at = 0) {
  return bytes.size() >= at + magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin() + at,
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

// TGA has no magic number: plausible fields of its header must do.
bool looks_like_tga(const Bytes& bytes) {
  if (bytes.size() < 18 || bytes[1] > 1) return false;
  const int kind = bytes[2] & ~8, depth = bytes[16];
  return kind >= 1 && kind <= 3 && (depth == 8 || depth == 15 || depth == 16 || depth == 24 || depth == 32);
}

// "png", "jpeg" and "openexr" are the formats that are read; all others are named for the error alone.
std::string format_of(const Bytes& bytes) {
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

void require_format(const std::filesystem::path& path, const std::string& format) {
  if (format != "png" && format != "jpeg" && format != "openexr")
    bad_data(path.string(), ": want a PNG, JPEG or EXR image, the content is ", format,
             "; convert it (magick IN OUT.png)");
  const std::string named = format_of_name(path);
  if (!named.empty() && named != format)
    bad_data(path.string(), ": named as ", named, " but the content is ", format, "; rename it");
}

// Chunks of length, name, data, CRC up to IEND. www.w3.org/TR/png, section 5
// libpng would find wrong CRCs too, but prints on its own besides.
void require_sound_png(const std::filesystem::path& path, const Bytes& bytes) {
  ByteReader reader(bytes, path.string());
  reader.skip(8, "the PNG signature");
  for (std::uint64_t kind = 0; kind != 0x49454e44;) {  // "IEND"
    const auto length = reader.big(4, "a PNG chunk");
    const std::size_t start = reader.offset();
    kind = reader.big(4, "a PNG chunk");
    reader.skip(length, "a PNG chunk");
    const auto crc = crc32(0, bytes.data() + start, static_cast<unsigned>(length + 4));
    if (reader.big(4, "a PNG chunk") != crc)
      damaged(path, text("the checksum at byte ", reader.offset() - 4, " is wrong"));
  }
}

// Marker segments up to EOI. After a scan header come coded bytes, where ff is followed by 0 or a restart marker.
// ITU-T T.81, annex B
void require_complete_jpeg(const std::filesystem::path& path, const Bytes& bytes) {
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
    if (length < 2) damaged(path, text("a JPEG segment of length ", length, " at byte ", reader.offset()));
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
void require_sound_exr(const std::filesystem::path& path, const Bytes& bytes) {
  constexpr std::uint32_t deep = 0x800, several = 0x1000;
  ByteReader reader(bytes, path.string());
  reader.skip(4, "the EXR signature");
  const auto version = reader.little<std::uint32_t>("the EXR version");
  if (version & deep) damaged(path, "deep EXR images, with several samples per pixel, are not supported");
  std::int64_t parts = 0;
  for (ExrHeader header; read_exr_header(reader, header); header = {}) {
    if (header.width < 1 || header.height < 1 || header.width > kLongestSide || header.height > kLongestSide)
      damaged(path, text("the header says ", header.width, "x", header.height, " pixels"));
    parts += header.parts();
    if (!(version & several)) break;
  }
  if (parts > static_cast<std::int64_t>(reader.remaining() / 8))
    damaged(path, text("the header declares ", parts, " parts, only ", reader.remaining(), " bytes follow"));
}

// An opened decoder and the memory that it reads from.
struct Decoder {
  std::filesystem::path path;
  Bytes bytes;
  std::unique_ptr<OIIO::Filesystem::IOMemReader> memory;
  std::unique_ptr<OIIO::ImageInput> input;
  OIIO::ImageSpec spec;
  std::string format;
};

/// Small files can promise gigabytes; what they promise is known before any pixel is decoded.
void require_proportion(const Decoder& decoder) {
  const OIIO::ImageSpec& spec = decoder.spec;
  const std::uint64_t pixels = spec.image_pixels(), file = decoder.bytes.size();
  const auto bits = static_cast<std::uint64_t>(
      spec.get_int_attribute("oiio:BitsPerSample", static_cast<int>(8 * spec.format.size())));
  const std::uint64_t raw = pixels * static_cast<std::uint64_t>(spec.nchannels) * bits / 8;
  const std::uint64_t most = decoder.format == "openexr" ? kMaxShrunkExr : kMaxShrunk;
  const bool held = raw <= kSmall || raw / most <= file;
  const bool flat = 4 * pixels > kMuch && 4 * pixels / kMinShareOfMuch > file;
  if (held && !flat) return;
  bad_data(decoder.path.string(), ": the header says ", spec.width, "x", spec.height, " pixels with ", spec.nchannels,
           " channels, but the file has only ", file, " bytes: it is damaged, or crafted to exhaust memory");
}

/// How many lines the file's compression packs together. openexr.com/en/latest/OpenEXRFileLayout.html
int lines_in_block(const OIIO::ImageSpec& spec) {
  if (spec.tile_height > 0) return spec.tile_height;
  std::string compression = spec.get_string_attribute("compression", "none");
  compression = compression.substr(0, compression.find(':'));  // "dwaa:45"
  if (compression == "dwab") return 256;
  if (compression == "piz" || compression == "b44" || compression == "b44a" || compression == "dwaa") return 32;
  return compression == "zip" || compression == "pxr24" ? 16 : 1;
}

void require_exr_layout(const Decoder& decoder) {
  const OIIO::ImageSpec& spec = decoder.spec;
  if (spec.x != spec.full_x || spec.y != spec.full_y || spec.width != spec.full_width ||
      spec.height != spec.full_height)
    bad_data(decoder.path.string(), ": the data window (", spec.width, "x", spec.height, " at ", spec.x, ", ", spec.y,
             ") is not the display window (", spec.full_width, "x", spec.full_height,
             "); save the image without cropping or overscan");
  const int width = spec.tile_width > 0 ? spec.tile_width : spec.width;
  const auto block = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(lines_in_block(spec)) *
                     static_cast<std::uint64_t>(spec.nchannels) * sizeof(float);
  if (block <= kLargestBlock) return;
  bad_data(decoder.path.string(), ": blocks of ", width, "x", lines_in_block(spec),
           " pixels are too large to decode; save the image in smaller tiles, or with zip");
}

void require_spec(const std::filesystem::path& path, const OIIO::ImageSpec& spec, int max_channels) {
  const bool sides =
      spec.width > 0 && spec.height > 0 && spec.depth <= 1 && spec.width <= kLongestSide && spec.height <= kLongestSide;
  const bool channels = spec.nchannels >= 1 && spec.nchannels <= max_channels;
  const int deep = spec.format.is_floating_point() ? 4 : 1;  // such pixels pass through floats
  if (sides && channels && spec.image_pixels() * spec.nchannels * deep <= kMaxImageValues) return;
  bad_data(path.string(), ": the header says ", spec.width, "x", spec.height, " pixels with ", spec.nchannels,
           " channels; the limit is ", kMaxImageValues, " values and ", max_channels, " channels");
}

/// The decoder of bytes that are, or begin, an image of its format.
void start(Decoder& decoder, const std::filesystem::path& path) {
  OIIO::attribute("try_all_readers", 0);
  decoder.memory = std::make_unique<OIIO::Filesystem::IOMemReader>(decoder.bytes.data(), decoder.bytes.size());
  decoder.input = OIIO::ImageInput::create(decoder.format);
  if (!decoder.input) damaged(path, text("OpenImageIO has no ", decoder.format, " reader: ", OIIO::geterror()));
  OIIO::ImageSpec options;
  options.attribute("oiio:UnassociatedAlpha", 1);  // straight alpha, as stored in PNG
  decoder.input->set_ioproxy(decoder.memory.get());
  if (!decoder.input->open(path.string(), decoder.spec, options)) damaged(path, decoder.input->geterror());
}

Decoder open(const std::filesystem::path& path, int max_channels) {
  Decoder decoder;
  decoder.path = path;
  decoder.bytes = read_file(path, kMaxImageBytes);
  decoder.format = format_of(decoder.bytes);
  require_format(path, decoder.format);
  if (decoder.format == "png") require_sound_png(path, decoder.bytes);
  if (decoder.format == "jpeg") require_complete_jpeg(path, decoder.bytes);
  if (decoder.format == "openexr") require_sound_exr(path, decoder.bytes);
  start(decoder, path);
  require_spec(path, decoder.spec, max_channels);
  require_proportion(decoder);
  if (decoder.format == "openexr") require_exr_layout(decoder);
  return decoder;
}

template <class Value>
std::vector<Value> decode(Decoder& decoder, OIIO::TypeDesc type) {
  std::vector<Value> values(decoder.spec.image_pixels() * decoder.spec.nchannels);
  const bool read = decoder.input->read_image(0, 0, 0, decoder.spec.nchannels, type, values.data());
  if (!read || decoder.input->has_error()) damaged(decoder.path, decoder.input->geterror());
  return values;
}

/// A part of an image: columns and rows from x and y on.
struct Block {
  int x = 0, y = 0, width = 0, height = 0;
};

/// `take(block, values)` for one block after another, with the values as floats: an EXR is never held whole as such.
template <class Take>
void decode_blocks(Decoder& decoder, Take take) {
  const OIIO::ImageSpec& spec = decoder.spec;
  const bool tiled = spec.tile_width > 0;
  const std::size_t line = spec.width * spec.nchannels * sizeof(float);
  const int together = lines_in_block(spec), several = std::max(1, static_cast<int>(kAtOnce / (line * together)));
  const int across = tiled ? spec.tile_width : spec.width, down = tiled ? together : together * several;
  std::vector<float> values;
  for (int y = 0; y < spec.height; y += down) {
    for (int x = 0; x < spec.width; x += across) {
      const Block block{x, y, std::min(across, spec.width - x), std::min(down, spec.height - y)};
      const int left = spec.x + x, top = spec.y + y, right = left + block.width, bottom = top + block.height;
      values.resize(static_cast<std::size_t>(block.width) * block.height * spec.nchannels);
      const bool read = tiled ? decoder.input->read_tiles(0, 0, left, right, top, bottom, 0, 1, 0, spec.nchannels,
                                                          OIIO::TypeDesc::FLOAT, values.data())
                              : decoder.input->read_scanlines(0, 0, top, bottom, 0, 0, spec.nchannels,
                                                              OIIO::TypeDesc::FLOAT, values.data());
      if (!read || decoder.input->has_error()) damaged(decoder.path, decoder.input->geterror());
      take(block, values);
    }
  }
}

std::uint8_t rounded(float value) {
  return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
}

/// A colour of a file, as it is kept.
float developed(float colour, const PhotoLight& light) {
  if (!light.linear && light.exposure == 1) return colour;
  return srgb_colour((light.linear ? colour : linear_colour(colour)) / static_cast<float>(light.exposure));
}

// EXR stores colours times alpha; Image wants them straight.
Bytes straight_8_bit(Decoder& decoder, const PhotoLight& light) {
  const std::size_t channels = static_cast<std::size_t>(decoder.spec.nchannels), width = decoder.spec.width;
  const bool has_alpha = channels == 2 || channels == 4, is_exr = decoder.format == "openexr";
  Bytes pixels(decoder.spec.image_pixels() * channels);
  decode_blocks(decoder, [&](const Block& block, const std::vector<float>& values) {
    for (std::size_t i = 0; i < values.size(); i += channels) {
      const std::size_t place = i / channels, row = block.y + place / block.width,
                        column = block.x + place % block.width;
      const float alpha = has_alpha ? values[i + channels - 1] : 0;
      for (std::size_t c = 0; c < channels; ++c) {
        if (!std::isfinite(values[i + c])) damaged(decoder.path, text("pixel ", column, ", ", row, " is not finite"));
        const bool is_alpha = has_alpha && c + 1 == channels, divide = is_exr && alpha > 0 && !is_alpha;
        const float value = divide ? values[i + c] / alpha : values[i + c];
        pixels[(row * width + column) * channels + c] = rounded(is_alpha ? value : developed(value, light));
      }
    }
  });
  return pixels;
}

/// Encoded in memory: OpenImageIO's writers do not tell when the disk refuses what they have buffered.
template <class Value>
Bytes encoded(const std::string& name, const char* format, const OIIO::ImageSpec& spec, const Value* values) {
  OIIO::Filesystem::IOVecOutput memory;
  const auto output = OIIO::ImageOutput::create(format);
  const bool done = output && output->set_ioproxy(&memory) && output->open(name, spec) &&
                    output->write_image(OIIO::BaseTypeFromC<Value>::value, values) && output->close();
  if (!done)
    throw Error(Fault::write, text(name, ": cannot be encoded: ", output ? output->geterror() : OIIO::geterror()));
  return memory.buffer();
}

template <class Value>
void write(const std::filesystem::path& path, const char* format, const OIIO::ImageSpec& spec, const Value* values) {
  const Bytes bytes = encoded(path.string(), format, spec, values);
  commit_bytes(path, std::as_bytes(std::span(bytes)));
}

OIIO::ImageSpec png_spec(const Image& image) {
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  return spec;
}

OIIO::ImageSpec jpeg_spec(const Image& image, int quality) {
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", text("jpeg:", quality));
  spec.attribute("jpeg:subsampling", "4:4:4");
  return spec;
}

}  // namespace

bool is_image_name(const std::filesystem::path& path) {
  const std::string format = format_of_name(path);
  return format == "png" || format == "jpeg" || format == "openexr";
}

namespace {

int orientation_of(const Decoder& decoder) {
  const int orientation = decoder.spec.get_int_attribute("Orientation", 1);
  return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

ImageSize size_of(const Decoder& decoder) {
  return {decoder.spec.width, decoder.spec.height, decoder.spec.nchannels, orientation_of(decoder)};
}

}  // namespace

ImageSize read_image_size(const std::filesystem::path& path) { return size_of(open(path, 4)); }

ImageSize peek_image_size(const std::filesystem::path& path) {
  Decoder decoder;
  decoder.path = path;
  std::ifstream file(path, std::ios::binary);
  const auto part = [&](std::size_t most) {
    Bytes bytes(most);
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(most));
    bytes.resize(static_cast<std::size_t>(file.gcount()));
    return bytes;
  };
  decoder.bytes = part(kPeeked);
  decoder.format = format_of(decoder.bytes);
  using namespace std::string_view_literals;
  const std::string_view end = decoder.format == "jpeg" ? "\xff\xd9"sv : "IEND\xae\x42\x60\x82"sv;
  file.clear();
  file.seekg(-static_cast<std::streamoff>(end.size()), std::ios::end);
  const bool peeks = decoder.format == "png" || decoder.format == "jpeg";
  if (!peeks || decoder.format != format_of_name(path) || !starts_with(part(end.size()), end))
    return read_image_size(path);
  try {
    start(decoder, path);
    require_spec(path, decoder.spec, 4);
  } catch (const Error&) {  // the header is longer, or damaged
    return read_image_size(path);
  }
  return size_of(decoder);
}

Image read_image(const std::filesystem::path& path) { return read_photo(path, {}); }

Image read_photo(const std::filesystem::path& path, const PhotoLight& light) {
  Decoder decoder = open(path, 4);
  Image image{decoder.spec.width, decoder.spec.height, decoder.spec.nchannels, {}};
  image.orientation = orientation_of(decoder);
  if (decoder.format == "openexr" || light.linear || light.exposure != 1) {
    image.pixels = straight_8_bit(decoder, light);
  } else {
    image.pixels = decode<std::uint8_t>(decoder, OIIO::TypeDesc::UINT8);
  }
  return image;
}

Labels read_labels(const std::filesystem::path& path) {
  Decoder decoder = open(path, 1);
  const bool deep = decoder.spec.format == OIIO::TypeDesc::UINT16;
  if (decoder.format != "png" || (!deep && decoder.spec.format != OIIO::TypeDesc::UINT8))
    bad_data(path.string(), ": want a PNG with 8-bit or 16-bit integers");
  Labels labels{decoder.spec.width, decoder.spec.height, {}};
  if (deep) {
    labels.values = decode<std::uint16_t>(decoder, OIIO::TypeDesc::UINT16);
  } else {
    const Bytes bytes = decode<std::uint8_t>(decoder, OIIO::TypeDesc::UINT8);
    labels.values.assign(bytes.begin(), bytes.end());
  }
  return labels;
}

FloatPlane read_exr_layer(const std::filesystem::path& path, const std::vector<std::string>& names) {
  Decoder decoder = open(path, 64);
  const auto& all = decoder.spec.channelnames;
  const auto found = std::find_first_of(names.begin(), names.end(), all.begin(), all.end());
  if (found == names.end())
    bad_data(path.string(), ": no layer ", OIIO::Strutil::join(names, " or "),
             ", it has: ", OIIO::Strutil::join(all, ", "));
  const std::size_t channel = std::find(all.begin(), all.end(), *found) - all.begin(), channels = all.size();
  FloatPlane layer{decoder.spec.width, decoder.spec.height, std::vector<float>(decoder.spec.image_pixels())};
  decode_blocks(decoder, [&](const Block& block, const std::vector<float>& values) {
    for (std::size_t i = 0; i * channels < values.size(); ++i)
      layer.values[(block.y + i / block.width) * layer.width + block.x + i % block.width] =
          values[i * channels + channel];
  });
  return layer;
}

std::vector<float> read_exr_layer(const std::filesystem::path& path, const std::string& name) {
  return read_exr_layer(path, std::vector<std::string>{name}).values;
}

void write_png(const std::filesystem::path& path, const Image& image, const std::string& description) {
  OIIO::ImageSpec spec = png_spec(image);
  if (!description.empty()) spec.attribute("ImageDescription", description);
  write(path, "png", spec, image.pixels.data());
}

void write_labels(const std::filesystem::path& path, const Labels& labels) {
  if (std::all_of(labels.values.begin(), labels.values.end(), [](std::uint16_t value) { return value < 256; }))
    return write_png(path, {labels.width, labels.height, 1, {labels.values.begin(), labels.values.end()}});
  const OIIO::ImageSpec spec(labels.width, labels.height, 1, OIIO::TypeDesc::UINT16);
  write(path, "png", spec, labels.values.data());
}

void write_jpeg(const std::filesystem::path& path, const Image& image) {
  write(path, "jpeg", jpeg_spec(image, kJpegQuality), image.pixels.data());
}

Bytes png_bytes(const Image& image) { return encoded("a picture", "png", png_spec(image), image.pixels.data()); }

Bytes jpeg_bytes(const Image& image, int quality) {
  return encoded("a picture", "jpeg", jpeg_spec(image, quality), image.pixels.data());
}

void write_exr(const std::filesystem::path& path, int width, int height, const std::vector<Layer>& layers) {
  const int channels = static_cast<int>(layers.size());
  OIIO::ImageSpec spec(width, height, channels, OIIO::TypeDesc::FLOAT);
  spec.attribute("compression", "zip");
  spec.channelnames.clear();
  for (const Layer& layer : layers) spec.channelnames.push_back(layer.name);
  const std::size_t count = std::size_t(width) * height;
  std::vector<float> values(count * channels);
  for (int c = 0; c < channels; ++c) {
    for (std::size_t i = 0; i < count; ++i) values[i * channels + c] = layers[c].values[i];
  }
  write(path, "openexr", spec, values.data());
}

}  // namespace cloam
