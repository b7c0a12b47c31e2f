// What image.h does to pixels in memory: smaller, turned, with other channels, made of values.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

// The mean of one box. Colours are weighted by alpha, so that the unseen colour of clear pixels leaves no fringe.
void average_box(const Image& image, int left, int top, int factor, std::uint8_t* result) {
  const int channels = image.channels, colours = channels % 2 == 0 ? channels - 1 : channels;
  std::uint64_t sums[4] = {}, weights = 0;
  for (int row = top; row < top + factor; ++row) {
    for (int column = left; column < left + factor; ++column) {
      const std::uint8_t* pixel = &image.pixels[(std::size_t(row) * image.width + column) * channels];
      const std::uint64_t alpha = colours == channels ? 1 : pixel[colours];
      for (int c = 0; c < colours; ++c) sums[c] += alpha * pixel[c];
      weights += alpha;
    }
  }
  for (int c = 0; c < colours; ++c) result[c] = weights ? (sums[c] + weights / 2) / weights : 0;
  const std::uint64_t count = std::uint64_t(factor) * factor;
  if (colours != channels) result[colours] = (weights + count / 2) / count;
}

// The pixels of a line of `from` that one of a line of `to` is made of.
struct Taps {
  int first = 0;
  std::vector<float> weights;  // of sum 1
};

std::vector<Taps> taps_of(int from, int to) {
  std::vector<Taps> all(static_cast<std::size_t>(to));
  const double scale = static_cast<double>(from) / to, reach = std::max(1.0, scale);
  for (int i = 0; i < to; ++i) {
    Taps& taps = all[static_cast<std::size_t>(i)];
    const double centre = (i + 0.5) * scale - 0.5;
    taps.first = std::max(0, static_cast<int>(std::ceil(centre - reach)));
    const int last = std::min(from - 1, static_cast<int>(std::floor(centre + reach)));
    double sum = 0;
    for (int at = taps.first; at <= last; ++at) sum += 1 - std::abs(at - centre) / reach;
    for (int at = taps.first; at <= last; ++at)
      taps.weights.push_back(static_cast<float>((1 - std::abs(at - centre) / reach) / sum));
  }
  return all;
}

// Values of several channels; colours are multiplied by alpha, which is from 0 to 1.
struct Plane {
  int width = 0, height = 0, channels = 0;
  std::vector<float> values;

  float* at(int row, int column) { return &values[(std::size_t(row) * width + column) * channels]; }
  const float* at(int row, int column) const { return &values[(std::size_t(row) * width + column) * channels]; }
};

Plane premultiplied(const Image& image) {
  Plane plane{image.width, image.height, image.channels, {image.pixels.begin(), image.pixels.end()}};
  if (image.channels % 2 != 0) return plane;
  for (std::size_t i = 0; i < plane.values.size(); i += std::size_t(image.channels)) {
    float& alpha = plane.values[i + std::size_t(image.channels) - 1];
    alpha /= 255;
    for (int c = 0; c < image.channels - 1; ++c) plane.values[i + std::size_t(c)] *= alpha;
  }
  return plane;
}

// Rows of another width, then turned: rows become columns.
Plane resampled_and_turned(const Plane& plane, int width) {
  const std::vector<Taps> all = taps_of(plane.width, width);
  Plane result{plane.height, width, plane.channels, {}};
  result.values.resize(std::size_t(width) * plane.height * plane.channels);
  for (int row = 0; row < plane.height; ++row) {
    for (int column = 0; column < width; ++column) {
      const Taps& taps = all[static_cast<std::size_t>(column)];
      float* sum = result.at(column, row);
      for (std::size_t tap = 0; tap < taps.weights.size(); ++tap) {
        const float* value = plane.at(row, taps.first + static_cast<int>(tap));
        for (int c = 0; c < plane.channels; ++c) sum[c] += taps.weights[tap] * value[c];
      }
    }
  }
  return result;
}

std::uint8_t to_byte(float value) { return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.f, 255.f))); }

}  // namespace

Image resized(const Image& image, int width, int height) {
  const Plane plane = resampled_and_turned(resampled_and_turned(premultiplied(image), width), height);
  Image result{width, height, image.channels, {}};
  const int alpha = image.channels % 2 == 0 ? image.channels - 1 : -1;
  for (std::size_t i = 0; i < plane.values.size(); i += std::size_t(image.channels)) {
    const float share = alpha < 0 ? 1 : plane.values[i + std::size_t(alpha)];
    const bool clear = to_byte(255 * share) == 0;
    for (int c = 0; c < image.channels; ++c) {
      const float value = plane.values[i + std::size_t(c)];
      result.pixels.push_back(c == alpha ? to_byte(255 * value) : clear ? 0 : to_byte(value / share));
    }
  }
  return result;
}

Image to_image(const std::vector<float>& values, int width, int height) {
  Image image{width, height, 3, std::vector<std::uint8_t>(values.size())};
  std::transform(values.begin(), values.end(), image.pixels.begin(),
                 [](float value) { return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.f, 1.f))); });
  return image;
}

Image downscale(const Image& image, int factor) {
  if (factor < 1 || factor > image.width || factor > image.height) {
    throw Error(Fault::usage, text("--downscale ", factor, " of an image of ", image.width, "x", image.height,
                                   " pixels leaves nothing: want 1 to ", std::min(image.width, image.height)));
  }
  if (factor == 1) return image;
  Image result{image.width / factor, image.height / factor, image.channels, {}};
  result.pixels.resize(std::size_t(result.width) * result.height * result.channels);
  std::uint8_t* next = result.pixels.data();
  for (int row = 0; row < result.height; ++row) {
    for (int column = 0; column < result.width; ++column, next += image.channels) {
      average_box(image, column * factor, row * factor, factor, next);
    }
  }
  return result;
}

// Where the pixel (row, column) of the result lies: JEITA CP-3451, tag 274. 5 to 8 change rows and columns.
std::vector<std::size_t> upright_places(int width, int height, int orientation) {
  const bool swap = orientation >= 5;
  const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  std::vector<std::size_t> places;
  places.reserve(std::size_t(width) * height);
  for (int row = 0; row < (swap ? width : height); ++row) {
    for (int column = 0; column < (swap ? height : width); ++column) {
      const int down = swap ? column : row, across = swap ? row : column;
      const std::size_t from_row = from_bottom ? height - 1 - down : down;
      places.push_back(from_row * width + (from_right ? width - 1 - across : across));
    }
  }
  return places;
}

Image upright(const Image& image, int orientation) {
  if (orientation <= 1) return image;
  const bool swap = orientation >= 5;
  Image result{swap ? image.height : image.width, swap ? image.width : image.height, image.channels, {}};
  result.pixels.reserve(image.pixels.size());
  for (const std::size_t place : upright_places(image.width, image.height, orientation)) {
    const auto pixel = image.pixels.begin() + static_cast<std::ptrdiff_t>(place * image.channels);
    result.pixels.insert(result.pixels.end(), pixel, pixel + image.channels);
  }
  return result;
}

namespace {

/// Four bytes at once, the last of which is the next pixel's: photos are read during steps, and nearly all are RGB.
std::vector<std::uint8_t> rgba_of_rgb(const std::vector<std::uint8_t>& rgb) {
  const std::size_t count = rgb.size() / 3;
  std::vector<std::uint8_t> rgba(4 * count, 255);
  for (std::size_t i = 0; i + 1 < count; ++i) {
    std::memcpy(&rgba[4 * i], &rgb[3 * i], 4);
    rgba[4 * i + 3] = 255;
  }
  if (count > 0) std::memcpy(&rgba[4 * (count - 1)], &rgb[3 * (count - 1)], 3);
  return rgba;
}

}  // namespace

std::vector<std::uint8_t> as_rgba(const Image& image) {
  if (image.channels == 3) return rgba_of_rgb(image.pixels);
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

}  // namespace cloam
