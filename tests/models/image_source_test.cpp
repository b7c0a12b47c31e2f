// Pixels that a training draws: squares of a photo's pixels are as one pixel of a smaller photo.
#include "models/batches/image_source.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <map>
#include <random>

using namespace cloam;

namespace {

constexpr std::pair<int, int> kSizes[] = {{9, 7}, {13, 6}, {3, 2}};

/// Photos of random pixels, each with a camera of its own; all cameras stand where the world has its axes.
struct Photos {
  Scene scene;
  Pixels pixels;
  Photos() {
    std::mt19937 random(3);
    for (const auto& [width, height] : kSizes) {
      Camera camera;
      camera.width = width, camera.height = height;
      camera.fx = camera.fy = width;
      camera.cx = width / 2.0, camera.cy = height / 2.0;
      FramePixels photo;
      photo.frame = pixels.frames.size();
      photo.camera = static_cast<int>(pixels.cameras.size());
      photo.width = width, photo.height = height;
      for (int i = 0; i < width * height; ++i) {
        for (int channel = 0; channel < 4; ++channel) photo.rgba.push_back(static_cast<uint8_t>(random() % 256));
        photo.mask.push_back(random() % 40 == 0 ? 0 : 255);
        photo.depth.push_back(1 + static_cast<float>(random() % 100));
      }
      Frame frame;
      frame.camera = photo.camera;
      frame.world_from_camera = Eigen::Matrix4d::Identity();
      scene.frames.push_back(frame);
      scene.cameras.push_back(camera);
      pixels.cameras.push_back(camera);
      pixels.frames.push_back(photo);
    }
  }
};

/// What one ray must be, in float64.
struct Wanted {
  Eigen::Vector3d way = Eigen::Vector3d::Zero();
  Eigen::Vector4d rgba = Eigen::Vector4d::Zero();
  double width = 0, used = 1, depth = 0;
};

Wanted square_of(const FramePixels& photo, const Camera& camera, int left, int top, int side) {
  Wanted out;
  const std::vector<float> directions = unit_directions(camera),
                           widths = pixel_widths(directions, camera.width, camera.height);
  for (int y = top; y < top + side; ++y)
    for (int x = left; x < left + side; ++x) {
      const auto at = static_cast<size_t>(y * photo.width + x);
      const double share = 1.0 / (side * side), alpha = photo.rgba[4 * at + 3] / 255.0;
      for (int k = 0; k < 3; ++k) {
        out.way[k] += share * directions[3 * at + static_cast<size_t>(k)];
        out.rgba[k] += share * alpha * photo.rgba[4 * at + static_cast<size_t>(k)] / 255.0;
      }
      out.rgba[3] += share * alpha;
      out.width += share * side * widths[at];
      if (photo.mask[at] == 0) out.used = 0;
      if (side == 1) out.depth = photo.depth[at] / out.way.normalized().z();
    }
  out.way.normalize();
  return out;
}

}  // namespace

TEST_CASE("pixels: coarse ones are the means of squares of a photo, as wide as these") {
  const Photos photos;
  SceneFrame frame;
  frame.contract = true;
  const PixelSource source(photos.scene, photos.pixels, frame, RayRange());
  std::vector<std::pair<int, Wanted>> all;  // by their sides
  for (const FramePixels& photo : photos.pixels.frames)
    for (const int side : {1, 2, 4})
      for (int top = 0; top + side <= photo.height; ++top)
        for (int left = 0; left + side <= photo.width; ++left)
          all.emplace_back(side,
                           square_of(photo, photos.pixels.cameras[static_cast<size_t>(photo.camera)], left, top, side));
  constexpr int64_t kRays = 900;
  const PixelBatch batch = source.draw(kRays, {5, 1, 0}, {}, {}, 0.5f);
  const std::vector<float> ways = batch.rays.directions.to_host(), rgba = batch.rgba.to_host(),
                           widths = batch.widths.to_host(), used = batch.used.to_host(),
                           depths = batch.depths.to_host();
  std::map<int, int> drawn;
  for (size_t r = 0; r < kRays; ++r) {
    const Eigen::Vector3d way(ways[3 * r], ways[3 * r + 1], ways[3 * r + 2]);
    // Of squares in the same direction it is the one as wide.
    const auto distance = [&](const Wanted& w) { return (w.way - way).norm() + std::abs(w.width - double(widths[r])); };
    const auto& [side, wanted] =
        *std::ranges::min_element(all, {}, [&](const auto& each) { return distance(each.second); });
    REQUIRE(distance(wanted) < 1e-5);
    for (int k = 0; k < 3; ++k)
      CHECK(double(rgba[4 * r + static_cast<size_t>(k)] * rgba[4 * r + 3]) ==
            doctest::Approx(wanted.rgba[k]).epsilon(1e-4));
    CHECK(double(rgba[4 * r + 3]) == doctest::Approx(wanted.rgba[3]).epsilon(1e-4));
    CHECK(double(used[r]) == wanted.used);
    CHECK(double(depths[r]) == doctest::Approx(wanted.depth).epsilon(1e-4));
    ++drawn[side];
  }
  for (const int side : {2, 4}) CHECK(drawn[side] > 0.1 * kRays);
  CHECK(drawn[1] > 0.4 * kRays);
}
