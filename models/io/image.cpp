// Images through OpenImageIO, opened only as the format that the content shows. The bytes are read once, walked to
// their end mark (a decoder may fill up a file that was cut short and say nothing), and decoded from memory.
#include "models/io/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t kMostValues = std::uint64_t{1} << 29;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 31;
constexpr int kLongestSide = 1 << 17;

[[noreturn]] void damaged(const std::filesystem::path& path, const std::string& why) {
  throw Error(Fault::data, text(path.string(), ": damaged image: ", why, "; copy it again, or use --skip-bad"));
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
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (extension == ".png") return "png";
  if (extension == ".jpg" || extension == ".jpeg") return "jpeg";
  if (extension == ".exr") return "openexr";
  return extension;
}

void require_format(const std::filesystem::path& path, const std::string& format) {
  if (format != "png" && format != "jpeg" && format != "openexr") {
    throw Error(Fault::data, text(path.string(), ": want a PNG, JPEG or EXR image, the content is ", format,
                                  "; convert it (magick IN OUT.png)"));
  }
  const std::string named = format_of_name(path);
  if (!named.empty() && named != format) {
    throw Error(Fault::data, text(path.string(), ": named as ", named, " but the content is ", format, "; rename it"));
  }
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

// An opened decoder and the memory that it reads from.
struct Decoder {
  Bytes bytes;
  std::unique_ptr<OIIO::Filesystem::IOMemReader> memory;
  std::unique_ptr<OIIO::ImageInput> input;
  OIIO::ImageSpec spec;
  std::string format;
};

void require_spec(const std::filesystem::path& path, const OIIO::ImageSpec& spec, int most_channels) {
  const bool sides =
      spec.width > 0 && spec.height > 0 && spec.depth <= 1 && spec.width <= kLongestSide && spec.height <= kLongestSide;
  const bool channels = spec.nchannels >= 1 && spec.nchannels <= most_channels;
  const int deep = spec.format.is_floating_point() ? 4 : 1;  // such pixels pass through floats
  if (sides && channels && spec.image_pixels() * spec.nchannels * deep <= kMostValues) return;
  throw Error(Fault::data,
              text(path.string(), ": the header says ", spec.width, "x", spec.height, " pixels with ", spec.nchannels,
                   " channels; the most that is read is ", kMostValues, " values and ", most_channels, " channels"));
}

Decoder open(const std::filesystem::path& path, int most_channels) {
  Decoder decoder;
  decoder.bytes = read_file(path, kMostBytes);
  decoder.format = format_of(decoder.bytes);
  require_format(path, decoder.format);
  if (decoder.format == "png") require_sound_png(path, decoder.bytes);
  if (decoder.format == "jpeg") require_complete_jpeg(path, decoder.bytes);
  OIIO::attribute("try_all_readers", 0);
  decoder.memory = std::make_unique<OIIO::Filesystem::IOMemReader>(decoder.bytes.data(), decoder.bytes.size());
  decoder.input = OIIO::ImageInput::create(decoder.format);
  if (!decoder.input) damaged(path, text("OpenImageIO has no ", decoder.format, " reader: ", OIIO::geterror()));
  OIIO::ImageSpec options;
  options.attribute("oiio:UnassociatedAlpha", 1);  // straight alpha, as stored in PNG
  decoder.input->set_ioproxy(decoder.memory.get());
  if (!decoder.input->open(path.string(), decoder.spec, options)) damaged(path, decoder.input->geterror());
  require_spec(path, decoder.spec, most_channels);
  return decoder;
}

template <class Value>
std::vector<Value> decode(const std::filesystem::path& path, Decoder& decoder, OIIO::TypeDesc type) {
  std::vector<Value> values(decoder.spec.image_pixels() * decoder.spec.nchannels);
  const bool read = decoder.input->read_image(0, 0, 0, decoder.spec.nchannels, type, values.data());
  if (!read || decoder.input->has_error()) damaged(path, decoder.input->geterror());
  return values;
}

// EXR stores colours times alpha; Image wants them straight.
Bytes straight_8_bit(const std::filesystem::path& path, const std::vector<float>& values, int channels) {
  Bytes pixels(values.size());
  const bool has_alpha = channels == 2 || channels == 4;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) damaged(path, text("pixel ", i / channels, " is not finite"));
    const std::size_t last = i / channels * channels + channels - 1;
    const bool divide = has_alpha && i != last && values[last] > 0;
    const float value = divide ? values[i] / values[last] : values[i];
    pixels[i] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
  }
  return pixels;
}

/// Encoded in memory: OpenImageIO's writers do not tell when the disk refuses what they have buffered.
template <class Value>
void write(const std::filesystem::path& path, const char* format, const OIIO::ImageSpec& spec, const Value* values) {
  OIIO::Filesystem::IOVecOutput memory;
  const auto output = OIIO::ImageOutput::create(format);
  const bool done = output && output->set_ioproxy(&memory) && output->open(path.string(), spec) &&
                    output->write_image(OIIO::BaseTypeFromC<Value>::value, values) && output->close();
  if (!done) {
    throw Error(Fault::write,
                text(path.string(), ": cannot be encoded: ", output ? output->geterror() : OIIO::geterror()));
  }
  commit_bytes(path, std::as_bytes(std::span(memory.buffer())));
}

}  // namespace

bool is_image_name(const std::filesystem::path& path) {
  const std::string format = format_of_name(path);
  return format == "png" || format == "jpeg" || format == "openexr";
}

ImageSize read_image_size(const std::filesystem::path& path) {
  const Decoder decoder = open(path, 4);
  return {decoder.spec.width, decoder.spec.height, decoder.spec.nchannels};
}

Image read_image(const std::filesystem::path& path) {
  Decoder decoder = open(path, 4);
  Image image{decoder.spec.width, decoder.spec.height, decoder.spec.nchannels, {}};
  const int orientation = decoder.spec.get_int_attribute("Orientation", 1);
  image.orientation = orientation >= 1 && orientation <= 8 ? orientation : 1;
  if (decoder.format == "openexr") {
    image.pixels = straight_8_bit(path, decode<float>(path, decoder, OIIO::TypeDesc::FLOAT), image.channels);
  } else {
    image.pixels = decode<std::uint8_t>(path, decoder, OIIO::TypeDesc::UINT8);
  }
  return image;
}

// Where the pixel (row, column) of the result lies: JEITA CP-3451, tag 274. 5 to 8 change rows and columns.
Image upright(const Image& image, int orientation) {
  if (orientation <= 1) return image;
  const bool swap = orientation >= 5;
  const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  Image result{swap ? image.height : image.width, swap ? image.width : image.height, image.channels, {}};
  result.pixels.reserve(image.pixels.size());
  for (int row = 0; row < result.height; ++row) {
    for (int column = 0; column < result.width; ++column) {
      const int down = swap ? column : row, across = swap ? row : column;
      const std::size_t from_row = from_bottom ? image.height - 1 - down : down;
      const std::size_t from_column = from_right ? image.width - 1 - across : across;
      const auto pixel = image.pixels.begin() + (from_row * image.width + from_column) * image.channels;
      result.pixels.insert(result.pixels.end(), pixel, pixel + image.channels);
    }
  }
  return result;
}

std::vector<std::uint8_t> as_rgba(const Image& image) {
  const int channels = image.channels, alpha = channels % 2 == 0 ? channels - 1 : -1;
  const std::size_t count = std::size_t(image.width) * image.height;
  std::vector<std::uint8_t> rgba(4 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* pixel = &image.pixels[i * channels];
    for (int c = 0; c < 3; ++c) rgba[4 * i + c] = pixel[channels < 3 ? 0 : c];
    rgba[4 * i + 3] = alpha < 0 ? 255 : pixel[alpha];
  }
  return rgba;
}

Labels read_labels(const std::filesystem::path& path) {
  Decoder decoder = open(path, 1);
  const bool deep = decoder.spec.format == OIIO::TypeDesc::UINT16;
  if (decoder.format != "png" || (!deep && decoder.spec.format != OIIO::TypeDesc::UINT8))
    throw Error(Fault::data, text(path.string(), ": want a PNG of whole numbers with 8 or 16 bit"));
  Labels labels{decoder.spec.width, decoder.spec.height, {}};
  if (deep) {
    labels.values = decode<std::uint16_t>(path, decoder, OIIO::TypeDesc::UINT16);
  } else {
    const Bytes bytes = decode<std::uint8_t>(path, decoder, OIIO::TypeDesc::UINT8);
    labels.values.assign(bytes.begin(), bytes.end());
  }
  return labels;
}

std::vector<float> read_exr_layer(const std::filesystem::path& path, const std::string& name) {
  Decoder decoder = open(path, 64);
  const auto& names = decoder.spec.channelnames;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    throw Error(Fault::data, text(path.string(), ": no layer ", name, ", it has: ", OIIO::Strutil::join(names, ", ")));
  }
  const auto all = decode<float>(path, decoder, OIIO::TypeDesc::FLOAT);
  std::vector<float> layer(decoder.spec.image_pixels());
  for (std::size_t i = 0; i < layer.size(); ++i) layer[i] = all[i * names.size() + (found - names.begin())];
  return layer;
}

void write_png(const std::filesystem::path& path, const Image& image, const std::string& description) {
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:UnassociatedAlpha", 1);
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
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", "jpeg:95");
  spec.attribute("jpeg:subsampling", "4:4:4");
  write(path, "jpeg", spec, image.pixels.data());
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
