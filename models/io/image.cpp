// Images through OpenImageIO, opened only as the format that the content shows. The bytes are read once, walked to
// their end mark (a decoder may fill up a file that was cut short and say nothing), and decoded from memory.
#include "models/io/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <numeric>
#include <span>

#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/image_bytes.h"
#include "models/io/srgb.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t kMaxImageValues = std::uint64_t{1} << 29;
constexpr int kMostChannels = 64;  // of an EXR; other formats have four at most
constexpr std::uint64_t kMaxImageBytes = std::uint64_t{1} << 31;
// What a header may promise, measured by the bytes that follow. Deflate shrinks to 1/1032 at best, JPEG to about that;
// of EXR's other compressions some write a block of equal pixels in a few bytes.
constexpr std::uint64_t kMaxShrunk = 1100, kMaxShrunkExr = 10000;
constexpr std::uint64_t kSmall = 16 << 20;         // bytes of pixels that nobody needs to ask about
constexpr std::uint64_t kMuch = 256 << 20;         // bytes as RGBA from which on a file must hold more than flat colour
constexpr std::uint64_t kMinShareOfMuch = 200;     // of these bytes to one of the file
constexpr std::uint64_t kLargestBlock = 64 << 20;  // bytes of one tile, or of the lines that are compressed together
constexpr std::size_t kPeeked = 64 << 10;          // bytes in which a header usually ends
constexpr std::uint64_t kAtOnce = 8 << 20;         // bytes of lines that are decoded in one call, if blocks are small

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

void require_spec(const std::filesystem::path& path, const OIIO::ImageSpec& spec) {
  const int kept = std::min(spec.nchannels, 4);  // at most, whatever else an EXR has
  const bool sides = spec.width > 0 && spec.height > 0 && spec.depth <= 1 && spec.width <= kLongestImageSide &&
                     spec.height <= kLongestImageSide;
  const bool channels = spec.nchannels >= 1 && spec.nchannels <= kMostChannels;
  const int deep = spec.format.is_floating_point() ? 4 : 1;  // such pixels pass through floats
  if (sides && channels && spec.image_pixels() * kept * deep <= kMaxImageValues) return;
  bad_data(path.string(), ": the header says ", spec.width, "x", spec.height, " pixels with ", spec.nchannels,
           " channels; the limit is ", kMaxImageValues, " values and ", kMostChannels, " channels");
}

using Channels = std::map<std::string, int>;  // numbers of channels by name, in small letters

/// Of one layer: R G B, else Y that is no direction, and A.
std::vector<int> colours_of(const Channels& layer) {
  const auto number = [&](const char* letter, const char* word) {
    const auto at = layer.contains(letter) ? layer.find(letter) : layer.find(word);
    return at == layer.end() ? -1 : at->second;
  };
  std::vector<int> found = {number("r", "red"), number("g", "green"), number("b", "blue")};
  if (std::find(found.begin(), found.end(), -1) != found.end()) found.clear();
  if (found.empty() && layer.contains("y") && !layer.contains("x")) found = {layer.at("y")};
  const int alpha = number("a", "alpha");
  if (!found.empty() && alpha >= 0) found.push_back(alpha);
  return found;
}

/// The channels of a photo in an EXR, by name: of the picture itself, else of its only layer that has colours or of the
/// one that Blender calls Combined. Empty where there is none.
std::vector<int> colour_channels(const std::vector<std::string>& names) {
  std::map<std::string, Channels> layers;  // by the layer's name with its point
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::size_t letter = names[i].rfind('.') + 1;  // 0 where there is no point
    layers[names[i].substr(0, letter)].emplace(lower_case(names[i].substr(letter)), static_cast<int>(i));
  }
  const Channels& first = layers.begin()->second;
  const bool colourless = first.contains("x") || first.contains("z") || first.contains("depth");
  if (names.size() == 1 && !colourless) return {0};  // grey, by whatever name
  std::vector<std::vector<int>> found;
  for (const auto& [name, layer] : layers) {
    const std::vector<int> colours = colours_of(layer);
    if (!colours.empty() && (name.empty() || lower_case(name).ends_with("combined."))) return colours;
    if (!colours.empty()) found.push_back(colours);
  }
  return found.size() == 1 ? found.front() : std::vector<int>();
}

/// Numbers of the channels that make the photo.
std::vector<int> photo_channels(const Decoder& decoder) {
  std::vector<int> channels(static_cast<std::size_t>(decoder.spec.nchannels));
  std::iota(channels.begin(), channels.end(), 0);
  if (decoder.format != "openexr") return channels;
  channels = colour_channels(decoder.spec.channelnames);
  if (!channels.empty()) return channels;
  bad_data(decoder.path.string(), ": looked for channels R, G, B (and A) or Y, of one layer at most, found ",
           OIIO::Strutil::join(decoder.spec.channelnames, ", "), "; save the picture's colours under these names");
}

/// The decoder of bytes that are, or begin, an image of its format.
void start(Decoder& decoder, const std::filesystem::path& path) {
  OIIO::attribute("try_all_readers", 0);
  decoder.memory = std::make_unique<OIIO::Filesystem::IOMemReader>(decoder.bytes.data(), decoder.bytes.size());
  decoder.input = OIIO::ImageInput::create(decoder.format);
  if (!decoder.input) damaged_image(path, text("OpenImageIO has no ", decoder.format, " reader: ", OIIO::geterror()));
  OIIO::ImageSpec options;
  options.attribute("oiio:UnassociatedAlpha", 1);  // straight alpha, as stored in PNG
  decoder.input->set_ioproxy(decoder.memory.get());
  if (!decoder.input->open(path.string(), decoder.spec, options)) damaged_image(path, decoder.input->geterror());
}

Decoder open(const std::filesystem::path& path) {
  Decoder decoder;
  decoder.path = path;
  decoder.bytes = read_file(path, kMaxImageBytes);
  decoder.format = format_of(decoder.bytes);
  require_format(path, decoder.format, decoder.bytes);
  require_sound_bytes(path, decoder.format, decoder.bytes);
  start(decoder, path);
  require_spec(path, decoder.spec);
  require_proportion(decoder);
  if (decoder.format == "openexr") require_exr_layout(decoder);
  return decoder;
}

template <class Value>
std::vector<Value> decode(Decoder& decoder, OIIO::TypeDesc type) {
  std::vector<Value> values(decoder.spec.image_pixels() * decoder.spec.nchannels);
  const bool read = decoder.input->read_image(0, 0, 0, decoder.spec.nchannels, type, values.data());
  if (!read || decoder.input->has_error()) damaged_image(decoder.path, decoder.input->geterror());
  return values;
}

/// RGB with an alpha of 255, without a copy between.
Bytes decode_opaque(Decoder& decoder) {
  Bytes values(decoder.spec.image_pixels() * 4, 255);
  const bool read = decoder.input->read_image(0, 0, 0, 3, OIIO::TypeDesc::UINT8, values.data(), 4);
  if (!read || decoder.input->has_error()) damaged_image(decoder.path, decoder.input->geterror());
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
      if (!read || decoder.input->has_error()) damaged_image(decoder.path, decoder.input->geterror());
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
  const std::vector<int> chosen = photo_channels(decoder);
  const std::size_t all = static_cast<std::size_t>(decoder.spec.nchannels), channels = chosen.size(),
                    width = decoder.spec.width;
  const bool has_alpha = channels == 2 || channels == 4, is_exr = decoder.format == "openexr";
  Bytes pixels(decoder.spec.image_pixels() * channels);
  decode_blocks(decoder, [&](const Block& block, const std::vector<float>& values) {
    for (std::size_t i = 0; i < values.size(); i += all) {
      const std::size_t place = i / all, row = block.y + place / block.width, column = block.x + place % block.width;
      const auto value_of = [&](std::size_t c) { return values[i + static_cast<std::size_t>(chosen[c])]; };
      const float alpha = has_alpha ? value_of(channels - 1) : 0;
      for (std::size_t c = 0; c < channels; ++c) {
        if (!std::isfinite(value_of(c)))
          damaged_image(decoder.path, text("pixel ", column, ", ", row, " is not finite"));
        const bool is_alpha = has_alpha && c + 1 == channels, divide = is_exr && alpha > 0 && !is_alpha;
        const float value = divide ? value_of(c) / alpha : value_of(c);
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
  return {decoder.spec.width, decoder.spec.height, static_cast<int>(photo_channels(decoder).size()),
          orientation_of(decoder)};
}

}  // namespace

ImageSize read_image_size(const std::filesystem::path& path) { return size_of(open(path)); }

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
    require_spec(path, decoder.spec);
  } catch (const Error&) {  // the header is longer, or damaged
    return read_image_size(path);
  }
  return size_of(decoder);
}

Image read_image(const std::filesystem::path& path) { return read_photo(path, {}); }

Image read_photo(const std::filesystem::path& path, const PhotoLight& light) {
  Decoder decoder = open(path);
  Image image{decoder.spec.width, decoder.spec.height, static_cast<int>(photo_channels(decoder).size()), {}};
  image.orientation = orientation_of(decoder);
  if (decoder.format == "openexr" || light.linear || light.exposure != 1) {
    image.pixels = straight_8_bit(decoder, light);
  } else if (image.channels == 3 && light.opaque) {
    image.channels = 4;
    image.pixels = decode_opaque(decoder);
  } else {
    image.pixels = decode<std::uint8_t>(decoder, OIIO::TypeDesc::UINT8);
  }
  return image;
}

Labels read_labels(const std::filesystem::path& path) {
  Decoder decoder = open(path);
  const bool deep = decoder.spec.format == OIIO::TypeDesc::UINT16;
  if (decoder.format != "png" || (!deep && decoder.spec.format != OIIO::TypeDesc::UINT8))
    bad_data(path.string(), ": want a PNG with 8-bit or 16-bit integers");
  if (decoder.spec.nchannels != 1)
    bad_data(path.string(), ": has ", decoder.spec.nchannels,
             " channels, want 1: a number a pixel, not a picture of them; save it as grey");
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
  Decoder decoder = open(path);
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
