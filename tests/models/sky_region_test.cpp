// What photos add to LiDAR: where the sky ends, and what only boxes cover.
#include "models/street/sky_region.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <functional>

#include "models/scene/pose.h"
#include "models/street/photo_hints.h"

using namespace cloam;

namespace {

constexpr int kWidth = 40, kHeight = 30;

FramePixels photo_of(const std::function<int(int, int)>& grey) {
  FramePixels photo;
  photo.width = kWidth;
  photo.height = kHeight;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (const int value : {grey(x, y), grey(x, y), grey(x, y), 255})
        photo.rgba.push_back(static_cast<uint8_t>(value));
  return photo;
}

}  // namespace

TEST_CASE("the sky is followed to where the photo has an edge, and what does not look like it is not of it") {
  const auto is_house = [](int x, int y) { return x >= 5 && x < 10 && y >= 2 && y < 12; };
  const FramePixels photo = photo_of([&](int x, int y) {
    return y >= 15 ? 90 : is_house(x, y) ? 150 : 200 + y + (x + y) % 2;
  });
  std::vector<uint8_t> kinds(kWidth * kHeight, 0);
  for (int y = 0; y < 10; ++y)
    std::fill_n(kinds.begin() + y * kWidth, kWidth, kSkyPixel);  // LiDAR stops short of roofs
  kinds[12 * kWidth + 30] = kMatterPixel;                        // a wire
  kinds[20 * kWidth + 30] = kMatterPixel | kActorPixel;
  const std::vector<uint8_t> before = kinds;
  follow_sky(kinds, photo);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      CAPTURE(x);
      CAPTURE(y);
      const auto i = static_cast<size_t>(y * kWidth + x);
      const int wanted = y >= 15 || i == 12 * kWidth + 30 ? before[i] : is_house(x, y) ? 0 : int{kSkyPixel};
      CHECK(int{kinds[i]} == wanted);
    }
  // In fog there is no edge: the area would be the whole photo, most of which LiDAR does not call sky.
  std::vector<uint8_t> fog = before;
  follow_sky(fog, photo_of([](int, int) { return 180; }));
  CHECK(std::count(fog.begin(), fog.end(), kSkyPixel) == 0);
  // Hardly any sky: nothing to compare with.
  std::vector<uint8_t> tunnel(kWidth * kHeight, 0);
  tunnel[5] = kSkyPixel;
  const std::vector<uint8_t> same = tunnel;
  follow_sky(tunnel, photo_of([](int x, int) { return 40 * (x % 2); }));
  CHECK(tunnel == same);
}

TEST_CASE("what photos show only where boxes are") {
  const Camera camera = {kWidth, kHeight, 40, 40, 20, 15};
  std::vector<uint8_t> kinds(kWidth * kHeight, 0);
  for (int y = 10; y < 20; ++y)
    for (int x = 15; x < 25; ++x) kinds[static_cast<size_t>(y * kWidth + x)] = kActorPixel | kMatterPixel;
  const std::vector<BoxesInPhoto> photos = {
      {camera, pose_from(Eigen::Matrix3d::Identity(), {0, 0, 0}), kinds},
      {camera, pose_from(Eigen::Matrix3d::Identity(), {1, 0, 0}), kinds},
  };
  const std::vector<float> points = {0.5f, 0,  10,   // in both photos' boxes
                                     0.5f, 0,  1,    // before the box of the one, beside that of the other
                                     4,    0,  10,   // beside both
                                     0.5f, 0,  -10,  // behind both cameras
                                     0.5f, 90, 10};  // in no photo
  const std::vector<bool> found = only_in_boxes(points, photos);
  CHECK(found == std::vector<bool>{true, false, false, false, false});
}
