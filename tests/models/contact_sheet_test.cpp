// Sheets of pictures: where pictures and their captions stand.
#include <doctest/doctest.h>

#include <algorithm>

#include "models/eval/pictures.h"
#include "models/io/draw_text.h"
#include "tests/models/errors.h"

using namespace cloam;

namespace {

constexpr int kSide = 60, kGap = 4;

Image grey() { return {kSide, kSide, 3, std::vector<std::uint8_t>(std::size_t(kSide) * kSide * 3, 128)}; }

/// A part of the sheet, a row after the other.
std::vector<std::uint8_t> part(const Image& sheet, int left, int top, int width, int height) {
  std::vector<std::uint8_t> pixels;
  for (int row = top; row < top + height; ++row) {
    const auto* from = &sheet.pixels[(std::size_t(row) * sheet.width + left) * 3];
    pixels.insert(pixels.end(), from, from + std::size_t(width) * 3);
  }
  return pixels;
}

bool is_white(const std::vector<std::uint8_t>& pixels) {
  return std::all_of(pixels.begin(), pixels.end(), [](std::uint8_t value) { return value == 255; });
}

}  // namespace

TEST_CASE("a sheet without captions holds pictures and white gaps alone") {
  const Image sheet = contact_sheet({grey(), grey(), grey()}, 2);
  CHECK(sheet.width == 2 * kSide + kGap);
  CHECK(sheet.height == 2 * kSide + kGap);
  CHECK(part(sheet, 0, 0, kSide, kSide) == grey().pixels);
  CHECK(is_white(part(sheet, kSide, 0, kGap, sheet.height)));
}

TEST_CASE("each picture's caption stands below it, in its cell alone") {
  REQUIRE_MESSAGE(can_draw_text(), "script/setup installs fonts-dejavu-core");
  const std::string endless(200, 'W');
  const Image sheet =
      contact_sheet({grey(), grey(), grey()}, 2, {{"1  3f2a", "Car"}, {"2  77c0", "Bus"}, {endless, endless}});
  const int cell = (sheet.height - kGap) / 2, strip = cell - kSide;
  REQUIRE(strip > 20);
  CHECK(sheet.width == 2 * kSide + kGap);
  CHECK(part(sheet, 0, 0, kSide, kSide) == grey().pixels);
  CHECK(part(sheet, 0, cell + kGap, kSide, kSide) == grey().pixels);
  const auto first = part(sheet, 0, kSide, kSide, strip), second = part(sheet, kSide + kGap, kSide, kSide, strip);
  CHECK_FALSE(is_white(first));
  CHECK_FALSE(is_white(second));
  CHECK(first != second);
  CHECK_FALSE(is_white(part(sheet, 0, kSide, kSide, strip / 2)));              // the number
  CHECK_FALSE(is_white(part(sheet, 0, kSide + strip / 2, kSide, strip / 2)));  // the label
  CHECK(is_white(part(sheet, kSide, 0, kGap, sheet.height)));                  // what is too long is cut
  CHECK_FALSE(is_white(part(sheet, 0, cell + kGap + kSide, kSide, strip)));
}

TEST_CASE("the pictures of a sheet are those that it was made of; no other picture is taken for a sheet") {
  std::vector<Image> images = {grey(), grey(), grey()};
  for (std::size_t i = 0; i < images.size(); ++i)
    for (std::size_t k = 0; k < images[i].pixels.size(); ++k)
      images[i].pixels[k] = static_cast<std::uint8_t>((k * (i + 3)) % 251);
  const std::vector<Image> found = images_of_sheet(contact_sheet(images, 3), 3);
  REQUIRE(found.size() == 3);
  for (std::size_t i = 0; i < found.size(); ++i) {
    CHECK(found[i].width == kSide);
    CHECK(found[i].pixels == images[i].pixels);
  }
  CHECK(holds(error_of([] { images_of_sheet(grey(), 3); }), "60x60 is no sheet of 3"));
}
