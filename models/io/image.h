// Images in and out. Input is PNG, JPEG or EXR as the file's CONTENT says, always 8 bit in memory; output is PNG, JPEG
// or an EXR with named float layers. No colour transform is applied but by read_photo. Pixels are as stored;
// whether to follow EXIF's orientation is for whoever knows what the poses belong to.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

/// Row-major, top row first, channels interleaved: [height, width, channels]. 1 grey, 2 grey + alpha, 3 RGB, 4 RGBA.
/// Alpha is straight: colours are not multiplied by it.
struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<std::uint8_t> pixels;
  int orientation = 1;  // EXIF's, from 1 to 8; 1: the stored top left is the top left
};

struct ImageSize {
  int width = 0;
  int height = 0;
  int channels = 0;
  int orientation = 1;  // as Image::orientation
};

/// By the extension: .png, .jpg, .jpeg, .exr in any case.
bool is_image_name(const std::filesystem::path& path);

/// The header alone. Errors as read_image, as far as the header shows them.
ImageSize read_image_size(const std::filesystem::path& path);

/// The same from the file's first bytes, where they hold the header, and its last ones, which are missing where it was
/// cut short: a hundredth of what a large file takes. What lies between them may be damaged.
ImageSize peek_image_size(const std::filesystem::path& path);

/// Fault::data for a file that is missing, of another format, named against its content, cut short or damaged, with
/// more than 4 channels, with more than 2^29 values (2^27 in an EXR), or with far fewer bytes than so many pixels take,
/// which is told from the header. Deeper pixels are rounded to 8 bit after clamping to [0, 1]; an EXR is decoded part
/// by part, so that no more than 64 MB of floats are held at once.
Image read_image(const std::filesystem::path& path);

/// What a photo's numbers stand for, and how they are wanted.
struct PhotoLight {
  bool linear = false;  // proportional to light; false: sRGB
  double exposure = 1;  // how much light they took in
  bool opaque = false;  // RGB may be read as RGBA with an alpha of 255: quicker than as_rgba of it
};

/// The photo as sRGB, at an exposure of 1: what is brighter than white is clamped. From the file's own precision,
/// rounded to 8 bit last. Fault::data as read_image.
Image read_photo(const std::filesystem::path& path, const PhotoLight& light);

/// The places of the upright image's pixels, row by row, in an image of that size as stored.
std::vector<std::size_t> upright_places(int width, int height, int orientation);

/// The image as it is to be looked at if its EXIF orientation is this one (1 to 8): mirrored, turned, or both.
Image upright(const Image& image, int orientation);

/// [height, width, 4]; grey images have three equal colours, and 255 is the alpha of those without.
std::vector<std::uint8_t> as_rgba(const Image& image);

/// Whole numbers a pixel, [height, width].
struct Labels {
  int width = 0;
  int height = 0;
  std::vector<std::uint16_t> values;
};

/// A PNG with one channel of 8 or 16 bit, as stored. Errors as read_image; Fault::data for other images.
Labels read_labels(const std::filesystem::path& path);

/// A PNG that read_labels reads, of 8 bit where that is enough. Replaces `path` in one step. Fault::write.
void write_labels(const std::filesystem::path& path, const Labels& labels);

/// An RGB image of values [H,W,3] in [0,1], which are clamped and rounded.
Image to_image(const std::vector<float>& values, int width, int height);

/// Mean over factor x factor boxes; a rest of rows or columns at the end is dropped, so the result has
/// floor(width / factor) columns. Colours are weighted by alpha. Fault::usage if nothing would be left.
Image downscale(const Image& image, int factor);

/// The whole image at another size, up to 2^14 pixels a side. Each pixel is a mean of those around its place, whose
/// weights fall linearly to 0 within one pixel of the coarser of the two grids: bilinear where the image grows, without
/// aliasing where it shrinks. Colours are weighted by alpha. The same size gives the same image, but for the colours of
/// clear pixels, which become 0.
Image resized(const Image& image, int width, int height);

/// Replaces `path` in one step. Fault::write if that fails. description: kept in the file as text; empty: none.
void write_png(const std::filesystem::path& path, const Image& image, const std::string& description = "");

constexpr int kJpegQuality = 95;
/// RGB or grey at that quality, colours not thinned out. Replaces `path` in one step. Fault::write if that fails.
void write_jpeg(const std::filesystem::path& path, const Image& image);

/// What write_png and write_jpeg write; a JPEG file is smaller the lower the quality (1 to 100).
std::vector<std::uint8_t> png_bytes(const Image& image);
std::vector<std::uint8_t> jpeg_bytes(const Image& image, int quality = kJpegQuality);

/// One float channel of an EXR: "R", "G", "B", "A", "depth.Z", "opacity.A"; values are [height, width].
struct Layer {
  std::string name;
  const float* values = nullptr;
};

/// All layers in one file as float32. By the convention of EXR, R G B are multiplied by A. Replaces `path` in one step.
void write_exr(const std::filesystem::path& path, int width, int height, const std::vector<Layer>& layers);

/// Numbers [height, width].
struct FloatPlane {
  int width = 0;
  int height = 0;
  std::vector<float> values;
};

/// The first of these layers that an EXR has. Fault::data if it has none of them.
FloatPlane read_exr_layer(const std::filesystem::path& path, const std::vector<std::string>& names);

/// One layer of an EXR, [height, width]. Fault::data if the file has no such layer (the error lists those it has).
std::vector<float> read_exr_layer(const std::filesystem::path& path, const std::string& name);

}  // namespace cloam
