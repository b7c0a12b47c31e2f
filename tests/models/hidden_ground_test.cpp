// Ground that an actor hides from cameras, against the shadow that its box casts: a wedge behind it.
#include "models/splat/hidden_ground.h"

#include <doctest/doctest.h>

#include <set>

#include "models/gaussians/initialise.h"
#include "models/street/takes_edits.h"
#include "models/train/trainer.h"
#include "tests/models/made_method.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

const Camera kWide{100, 50, 50, 50, 50, 25};  // looks at x over 45 degrees to either side
constexpr double kSide = 0.5;                 // metres
constexpr double kEnd = 30;                   // of the ground
/// The side of an actor's space that faces the camera: how far away, half of its width.
struct Face {
  double away, half;
};
constexpr Face kSmaller = {9.2, 0.8}, kLarger = {8.8, 1.2};  // than the box: what it hides for certain, and at all
constexpr float kWrong = 5;

double height_at(double x) { return 0.01 * (x - 10); }
double colour_at(double x, double y) { return 0.05 * x - 0.1 * y; }
/// Seen from (0, 0, 1.5), with so much room at the sides.
bool is_behind(const Face& face, double x, double y, double room) {
  return x > face.away + room && std::abs(y) < face.half / face.away * x - room;
}

Vector3d mean_of(const Gaussians& g, size_t i) {
  return Eigen::Map<const Eigen::Vector3f>(&g.means[3 * i]).cast<double>();
}

/// Points of a sloping plane. Those behind the actor have colours that no photo showed.
Gaussians sloping_ground() {
  PointCloud cloud;
  for (double x = 2.1; x < kEnd; x += kSide)
    for (double y = -15.1; y < 15; y += kSide)
      for (const double value : {x, y, height_at(x)}) cloud.positions.push_back(static_cast<float>(value));
  cloud.colours.assign(cloud.positions.size(), 128);
  Gaussians out = gaussians_from_points(cloud);
  for (size_t i = 0; i < out.count(); ++i) {
    const Vector3d at = mean_of(out, i);
    const float colour = is_behind(kLarger, at.x(), at.y(), 0) ? kWrong : static_cast<float>(colour_at(at.x(), at.y()));
    std::fill_n(&out.sh_first[3 * i], 3, colour);
  }
  return out;
}

struct Seen {
  FramePixels pixels{0, 0, 100, 50, {}, {}};
  std::vector<TimedPhoto> photos;
  explicit Seen(std::initializer_list<double> places) {
    for (const double y : places) photos.push_back({{pixels, kWide, toy_camera_pose(y)}, 0.05});
  }
};

Scene behind_an_actor(const std::filesystem::path& root) {
  Scene scene = toy_street(root);
  scene.actors = {toy_actor("1", {2, 2, 3}, 10, 0)};
  return scene;
}

}  // namespace

TEST_CASE("hidden ground lies where an actor's box casts its shadow, as high and of such a colour as beside it") {
  const Folder folder;
  const Scene scene = behind_an_actor(folder.path);
  const Seen seen({0});
  const Gaussians ground = hidden_ground(seen.photos, scene, sloping_ground(), kSide);
  std::set<std::pair<int, int>> cells;
  for (size_t i = 0; i < ground.count(); ++i) {
    const Vector3d at = mean_of(ground, i);
    CAPTURE(at.transpose());
    CHECK(is_behind(kSmaller, at.x(), at.y(), -1e-6));
    cells.emplace(std::lround(std::floor(at.x() / kSide)), std::lround(std::floor(at.y() / kSide)));
    if (at.x() > kEnd) continue;  // beyond all points
    CHECK(std::abs(at.z() - height_at(at.x())) < 0.02);
    for (size_t c = 0; c < 3; ++c)
      CHECK(std::abs(double{ground.sh_first[3 * i + c]} - colour_at(at.x(), at.y())) < 0.5);  // of 5
  }
  CHECK(cells.size() == ground.count());
  for (int x = 18; x < 2 * kEnd; ++x)
    for (int y = -8; y < 8; ++y)
      if (is_behind(kSmaller, (x + 0.5) * kSide, (y + 0.5) * kSide, 0.05)) CHECK(cells.contains({x, y}));
}

TEST_CASE("no ground is hidden that another photo shows, nor without actors") {
  const Folder folder;
  Scene scene = behind_an_actor(folder.path);
  const Gaussians background = sloping_ground();
  const Seen seen({0, 12});
  const Gaussians ground = hidden_ground(seen.photos, scene, background, kSide);
  CHECK(ground.count() > 0);
  for (size_t i = 0; i < ground.count(); ++i) {
    const Vector3d at = mean_of(ground, i);
    CAPTURE(at.transpose());
    CHECK(is_behind(kSmaller, at.x(), at.y(), -1e-6));
    CHECK(at.x() < 13);  // from there on, the shadows that both cameras see have parted
  }
  scene.actors.clear();
  CHECK(hidden_ground(seen.photos, scene, background, kSide).count() == 0);
}

TEST_CASE("street-gaussians: where an actor was that is taken away lies the ground, from a checkpoint, too") {
  const Folder folder;
  Scene scene = toy_street(folder.path);  // LiDAR sees the foot of the wall, 30 m ahead
  scene.actors = {toy_actor("1", {2, 4, 1.5}, 24, 0)};
  Scenes empty = {scene};
  empty.front().actors.front().boxes.clear();
  const auto made = [&](const char* side) {
    auto method = configured("street-gaussians", {{"initial.lidar", "300"},
                                                  {"initial.near", "1"},
                                                  {"initial.far", "1"},
                                                  {"initial.actor", "40"},
                                                  {"initial.fewest", "40"},
                                                  {"initial.ground", side},
                                                  {"sky.side", "4"}});
    method->build({scene}, 3);
    return method;
  };
  const View view = {scene.cameras[0], toy_camera_pose(0), 0, 0.05};
  const auto opacities = [&](Method& method) {
    as<TakesEdits>(method)->take_actors(empty);
    return shown(method, view).opacity;
  };
  const auto method = made("0.5"), without = made("0");
  for (Method* one : {method.get(), without.get()}) load_data(*one, scene, toy_pixels(scene));
  const std::vector<float> with_ground = opacities(*method), bare = opacities(*without);
  // The pixel of the ground at (26, 0), behind the actor, and one of the wall above it.
  const auto width = static_cast<size_t>(view.camera.width);
  const auto row = static_cast<size_t>(view.camera.cy + view.camera.fy * 1.5 / 26);
  CHECK(with_ground[row * width + width / 2] > 0.9f);
  CHECK(bare[row * width + width / 2] < 0.5f);
  CHECK(with_ground[2 * width + width / 2] == bare[2 * width + width / 2]);

  const SafetensorsFile saved = checkpoint_of(*method, {}, {});
  const auto restored = made("0.5");
  restore_method(*restored, saved);
  CHECK(opacities(*restored) == with_ground);
}
