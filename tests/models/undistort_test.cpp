// Photos through a lens made straight, and straight renders seen through a lens: a pattern that is a known function of
// the direction must stay that function.
#include "models/render/undistort.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

using namespace cloam;

namespace {

constexpr double kDegree = M_PI / 180;

const Camera kLenses[] = {
    {96, 64, 60, 58, 50, 31, CameraModel::opencv, {-0.2, 0.05, 0, 0}, 0.003, -0.002},
    {96, 64, 60, 58, 50, 31, CameraModel::opencv, {0.4, 0.1, 0.02, 0}, 0, 0, {0.5, 0.15, 0.01}},
    {96, 64, 55, 55, 48, 32, CameraModel::fisheye, {0.05, -0.01, 0.002, 0}, 0.003, -0.002, {}, {0.004, -0.005}},
    {96, 64, 70, 70, 48, 32, CameraModel::fov, {0.9, 0, 0, 0}},
};

// From 0 to 1, slowly changing, another in each colour.
Eigen::Vector3d pattern(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction.normalized();
  return 0.5 * Eigen::Vector3d(1 + std::sin(4 * d.x()), 1 + std::cos(5 * d.y()), 1 + std::sin(3 * d.x() - 4 * d.y()));
}

Eigen::Vector3d direction_at(const Camera& camera, int pixel) {
  return direction(camera, {pixel % camera.width + 0.5, pixel / camera.width + 0.5});
}

FramePixels photo_of(const Camera& camera) {
  FramePixels photo{3, 0, camera.width, camera.height, {}, {}};
  for (int i = 0; i < camera.width * camera.height; ++i) {
    for (const double value : pattern(direction_at(camera, i)))
      photo.rgba.push_back(static_cast<std::uint8_t>(std::lround(255 * value)));
    photo.rgba.push_back(255);
  }
  return photo;
}

Picture render_of(const Camera& camera) {
  Picture picture{camera.width, camera.height, {}, {}, {}, {}};
  for (int i = 0; i < camera.width * camera.height; ++i) {
    const Eigen::Vector3d value = pattern(direction_at(camera, i));
    for (const double colour : value) picture.rgb.push_back(static_cast<float>(colour));
    picture.depth.push_back(static_cast<float>(2 + value[0]));
    picture.opacity.push_back(static_cast<float>(value[1]));
    picture.actors.push_back(7);
  }
  return picture;
}

int count_of(const std::vector<std::uint8_t>& mask) {
  return static_cast<int>(std::count(mask.begin(), mask.end(), 255));
}

// Errors are kept apart: at the rim a pixel stands for its missing neighbour, so that it may be half a pixel off.
struct Worst {
  double inside = 0, rim = 0;

  void add(const Camera& from, const Eigen::Vector3d& direction, double error) {
    const Eigen::Vector2d at = project(from, direction);
    const bool whole = at.minCoeff() > 0.5 && at.x() < from.width - 0.5 && at.y() < from.height - 0.5;
    double& worst = whole ? inside : rim;
    worst = std::max(worst, std::abs(error));
  }
};

}  // namespace

TEST_CASE("a pinhole around a lens sees all that the lens sees") {
  for (const Camera& lens : kLenses) {
    const Camera pinhole = pinhole_around(lens);
    CHECK(pinhole.model == CameraModel::pinhole);
    CHECK(seen(pixel_map(lens, pinhole)).empty());
    CHECK(pinhole.width * pinhole.height < 3 * lens.width * lens.height);
    // As fine as the lens at its middle, and no larger than it must be: some pixel of each side is seen.
    const Eigen::Vector3d middle(1e-4, 0, 1);
    CHECK((project(pinhole, middle).x() - pinhole.cx) ==
          doctest::Approx(project(lens, middle).x() - lens.cx).epsilon(0.02));
    const auto mask = seen(pixel_map(pinhole, lens));
    const int w = pinhole.width, h = pinhole.height;
    if (mask.empty()) continue;
    int top = 0, bottom = 0, left = 0, right = 0;
    for (int x = 0; x < w; ++x) {
      top += mask[x] || mask[w + x];
      bottom += mask[(h - 1) * w + x] || mask[(h - 2) * w + x];
    }
    for (int y = 0; y < h; ++y) {
      left += mask[y * w] || mask[y * w + 1];
      right += mask[y * w + w - 1] || mask[y * w + w - 2];
    }
    CHECK(std::min({top, bottom, left, right}) > 0);
  }
}

TEST_CASE("a pinhole within a lens shows nothing that the lens does not see, and is as large as that allows") {
  for (const Camera& lens : kLenses) {
    const Camera within = pinhole_within(lens);
    CHECK(within.model == CameraModel::pinhole);
    CHECK(seen(pixel_map(within, lens)).empty());
    CHECK(within.width * within.height > 0.6 * lens.width * lens.height);
    // Three pixels more on every side are too many.
    Camera larger = within;
    larger.width += 6, larger.height += 6, larger.cx += 3, larger.cy += 3;
    CHECK_FALSE(seen(pixel_map(larger, lens)).empty());
  }
  CHECK(pinhole_within({96, 64, 60, 58, 50, 31}) == Camera{96, 64, 60, 58, 50, 31});
}

TEST_CASE("a photo through a lens is straightened: the pattern is where its direction says") {
  for (const Camera& lens : kLenses) {
    const Pixels straight = undistorted({{lens}, {photo_of(lens)}, false, {}});
    const Camera& pinhole = straight.cameras.at(0);
    const FramePixels& photo = straight.frames.at(0);
    CHECK(photo.frame == 3);
    CHECK(photo.width == pinhole.width);
    REQUIRE(photo.rgba.size() == 4u * pinhole.width * pinhole.height);
    Worst worst;
    int counted = 0;
    for (int i = 0; i < pinhole.width * pinhole.height; ++i) {
      if (!photo.mask.empty() && photo.mask[i] == 0) continue;
      const Eigen::Vector3d wanted = 255 * pattern(direction_at(pinhole, i));
      for (int c = 0; c < 3; ++c) worst.add(lens, direction_at(pinhole, i), photo.rgba[4 * i + c] - wanted[c]);
      CHECK(photo.rgba[4 * i + 3] == 255);
      ++counted;
    }
    CHECK(worst.inside < 1.3);  // rounded twice
    CHECK(worst.rim < 8);
    CHECK(counted >= 0.9 * lens.width * lens.height);
  }
}

TEST_CASE("a straight render through the lens is what the lens would have seen") {
  for (const Camera& lens : kLenses) {
    const Camera pinhole = pinhole_around(lens);
    const Picture there = resample(render_of(pinhole), pixel_map(lens, pinhole));
    const Picture wanted = render_of(lens);
    REQUIRE(there.rgb.size() == wanted.rgb.size());
    Worst worst;
    for (std::size_t i = 0; i < wanted.depth.size(); ++i) {
      const auto add = [&](float error) { worst.add(pinhole, direction_at(lens, static_cast<int>(i)), error); };
      for (std::size_t c = 0; c < 3; ++c) add(there.rgb[3 * i + c] - wanted.rgb[3 * i + c]);
      add(there.depth[i] - wanted.depth[i]);
      add(there.opacity[i] - wanted.opacity[i]);
    }
    CHECK(worst.inside < 2e-3);
    CHECK(worst.rim < 0.04);
    CHECK(there.actors == wanted.actors);
  }
}

TEST_CASE("a pinhole is its own: nothing is resampled") {
  const Camera camera{9, 7, 8, 8, 4.2, 3.1};
  CHECK(pinhole_around(camera) == camera);
  const PixelMap map = pixel_map(camera, camera);
  CHECK(map.same);
  CHECK(seen(map).empty());
  FramePixels photo = photo_of(camera);
  photo.rgba[5] = 77;
  CHECK(resample(photo, map).rgba == photo.rgba);
  const Picture picture = render_of(camera);
  CHECK(resample(picture, map).rgb == picture.rgb);
  CHECK(resample(picture, map).depth == picture.depth);
}

TEST_CASE("what a lens does not see is masked out, and masks go along") {
  const Camera lens{32, 32, 16, 16, 16, 16, CameraModel::fisheye};  // 57 degrees to each side
  const Camera pinhole = pinhole_around(lens);
  FramePixels photo = photo_of(lens);
  const auto all = resample(photo, pixel_map(pinhole, lens));
  REQUIRE_FALSE(all.mask.empty());
  for (int i = 0; i < pinhole.width * pinhole.height; ++i) {
    const Eigen::Vector2d at = project(lens, direction_at(pinhole, i));
    const bool inside = at.minCoeff() >= 0 && at.maxCoeff() <= 32;
    CHECK((all.mask[i] == 255) == inside);
    if (!inside) CHECK(all.rgba[4 * i + 3] == 0);
  }
  photo.mask.assign(32 * 32, 255);
  std::fill(photo.mask.begin(), photo.mask.begin() + 16 * 32, 0);  // the upper half
  const auto half = resample(photo, pixel_map(pinhole, lens));
  CHECK(count_of(half.mask) > 0.4 * count_of(all.mask));
  CHECK(count_of(half.mask) < 0.51 * count_of(all.mask));
  for (int i = 0; i < pinhole.width * pinhole.height; ++i) {
    if (direction_at(pinhole, i).y() < -0.05) CHECK(half.mask[i] == 0);
  }
}

TEST_CASE("a fisheye that looks behind is cut at 70 degrees to a side") {
  const Camera lens{400, 200, 100, 100, 200, 100, CameraModel::fisheye};  // 115 degrees to the left and right, 57 up
  const Camera pinhole = pinhole_around(lens);
  CHECK((pinhole.width - pinhole.cx) / pinhole.fx == doctest::Approx(std::tan(70 * kDegree)).epsilon(0.01));
  CHECK(pinhole.cx / pinhole.fx == doctest::Approx(std::tan(70 * kDegree)).epsilon(0.01));
  CHECK(pinhole.width * pinhole.height <= 4.1 * lens.width * lens.height);
  const auto mask = seen(pixel_map(lens, pinhole));
  REQUIRE_FALSE(mask.empty());
  CHECK(mask[100 * 400 + 200] == 255);
  CHECK(mask[100 * 400 + 200 + 120] == 255);  // 69 degrees
  CHECK(mask[100 * 400 + 200 + 124] == 0);
}

TEST_CASE("clear pixels lend no colour, depths of nothing no distance") {
  const Camera to{2, 1, 4, 4, 1, 0.5}, from{2, 1, 4, 4, 1.5, 0.5};  // half a pixel to the right
  FramePixels photo{0, 0, 2, 1, {200, 100, 50, 255, 0, 0, 0, 0}, {}};
  const FramePixels there = resample(photo, pixel_map(to, from));
  CHECK(std::vector<int>(there.rgba.begin(), there.rgba.begin() + 4) == std::vector<int>{200, 100, 50, 128});
  CHECK(there.mask.empty());
  const Picture picture{2, 1, std::vector<float>(6, 1), {5, 0}, {1, 0}, {}};
  CHECK(resample(picture, pixel_map(to, from)).depth.at(0) == doctest::Approx(5));
  CHECK(resample(picture, pixel_map(to, from)).opacity.at(0) == doctest::Approx(0.5));
}
