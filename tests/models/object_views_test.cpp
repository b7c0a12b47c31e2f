// Objects of logs and the filters of their benchmark, on cases built by hand, and masks that are wrong on purpose.
#include "models/data/object_views.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <functional>
#include <set>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/commit.h"
#include "models/io/host_random.h"
#include "models/io/image.h"
#include "models/scene/pose.h"
#include "models/synth/street_log.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/toy_street.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

constexpr int kWidth = 100, kHeight = 80;

bool in_box(int column, int row, const PixelBox& box) {
  return column >= box.left && column < box.right && row >= box.top && row < box.bottom;
}

Actor actor_at(const std::string& id, const Eigen::Vector3d& centre, const Eigen::Vector3d& size) {
  return {id, "Car", size, false, {{0, 0, toy_pose(centre.x(), centre.y(), centre.z())}}, {}};
}

/// A camera at the origin that looks along z, and a car whose near side is 10 m away and 4 m wide and high: its 2-D box
/// is columns 30 to 69, rows 20 to 59.
struct Planted {
  Planted() {
    log.root = folder.path;
    log.is_log = true;
    log.cameras = {{kWidth, kHeight, 100, 100, 50, 40}};
    log.actors = {actor_at("car", {0, 0, 11}, {4, 4, 2})};
    Frame frame;
    frame.image = "camera/front_camera/00.jpg";
    frame.sensor = "front_camera";
    frame.timestamp = 0;
    log.frames = {frame};
    commit_text(folder.path / "truth/actors.json", R"({"1": "car"})");
    see([](int column, int row) { return in_box(column, row, {30, 20, 50, 60}); });
    put_points({});
  }

  /// Which pixels the mask of the car has.
  void see(const std::function<bool(int column, int row)>& car) {
    Labels labels{kWidth, kHeight, {}};
    for (int row = 0; row < kHeight; ++row)
      for (int column = 0; column < kWidth; ++column) labels.values.push_back(car(column, row));
    write_labels(folder.path / "truth/front_camera/00_actor.png", labels);
  }

  void put_points(const std::vector<Eigen::Vector3d>& points) {
    std::ofstream file(folder.path / "0.bin", std::ios::binary);
    for (const Eigen::Vector3d& p : points) {
      const float values[4] = {float(p.x()), float(p.y()), float(p.z()), 0.5f};
      file.write(reinterpret_cast<const char*>(values), sizeof values);
    }
    log.sweeps = {{"0.bin", 0, Eigen::Matrix4d::Identity(), 0, Split::train, true}};
  }

  ObjectsInImage all(const ObjectFilters& filters = {}) const {
    const ActorMasks masks(log);
    ObjectFinder finder(log, masks, filters);
    const FramePixels photo{0, 0, kWidth, kHeight, std::vector<std::uint8_t>(4 * kWidth * kHeight, 255), {}};
    return finder.objects(photo, log.cameras[0]);
  }
  ObjectView car(const ObjectFilters& filters = {}) const { return all(filters).objects.at(0); }

  Folder folder;
  Scene log;
};

/// Within the box of the car, seen at the centre of that pixel.
Eigen::Vector3d point_at(double column, double row) {
  return {(column + 0.5 - 50) * 0.105, (row + 0.5 - 40) * 0.105, 10.5};
}

std::vector<Eigen::Vector3d> points(int on_mask, int beside) {
  std::vector<Eigen::Vector3d> all;
  for (int i = 0; i < on_mask; ++i) all.push_back(point_at(33 + i % 16, 25 + i / 16));
  for (int i = 0; i < beside; ++i) all.push_back(point_at(51 + i % 16, 25 + i / 16));
  return all;
}

/// Columns left to right of all rows, 5 m away: in front of the car.
Actor in_front(const std::string& id, double left, double right) {
  return actor_at(id, {((left + right) / 2 - 50) * 0.05, 0, 5.5}, {(right - left) * 0.05, 4, 1});
}

}  // namespace

TEST_CASE("an object's box, square and pose are those of its projection") {
  Planted planted;
  const ObjectView car = planted.car();
  CHECK(car.box == PixelBox{30, 20, 70, 60});
  CHECK(car.square == PixelBox{28, 18, 72, 62});
  CHECK(car.pixels == 20 * 40);
  CHECK(car.box_from_camera.isApprox(toy_pose(0, 0, -11)));
  CHECK(planted.all().mask_file);
  planted.log.actors[0].label = "Signs";
  CHECK(planted.all().objects.empty());
  CHECK(planted.all().other == 1);
  planted.log.actors[0] = actor_at("car", {1.6, 0, 11}, {8, 4, 2});  // leaves the image
  CHECK(planted.car().box == PixelBox{26, 20, 100, 60});
  for (const auto& [x, z] : {std::pair(40., 11.), std::pair(0., -11.), std::pair(0., 0.5)}) {  // beside, behind, around
    planted.log.actors[0] = actor_at("car", {x, 0, z}, {4, 4, 2});
    CHECK(planted.all().objects.empty());
  }
  planted.log.actors[0].boxes[0].step = 1;
  CHECK(planted.all().objects.empty());
}

TEST_CASE("30 % of the LiDAR points beside the mask are kept, one more is rejected") {
  Planted planted;
  for (const int tens : {1, 3, 7, 9}) {
    CAPTURE(tens);
    planted.put_points(points(7 * tens, 3 * tens));
    const ObjectView kept = planted.car();
    CHECK(kept.lidar_inside == 7 * tens);
    CHECK(kept.lidar_outside == 3 * tens);
    CHECK(kept.outcome == ObjectOutcome::kept);
    planted.put_points(points(7 * tens, 3 * tens + 1));
    CHECK(planted.car().outcome == ObjectOutcome::lidar_outside);
  }
  planted.put_points(points(71, 29));  // 0.29 * 100 is less than 29
  CHECK(planted.car({.most_outside = 0.29}).outcome == ObjectOutcome::kept);
}

TEST_CASE("points of other places do not count, and an object without any is kept") {
  Planted planted;
  ObjectView car = planted.car();
  CHECK_FALSE(car.has_lidar());
  CHECK(car.outcome == ObjectOutcome::kept);
  std::vector<Eigen::Vector3d> elsewhere = {{1, 0, 9.9}, {1, 0, 12.1}, {2.1, 0, 11}, {1, -2.1, 11}};  // about the box
  planted.put_points(elsewhere);
  CHECK_FALSE(planted.car().has_lidar());
  planted.log.actors[0] = actor_at("car", {4, 0, 11}, {8, 4, 2});
  planted.see([](int column, int) { return column >= 50; });
  planted.put_points({{1, 0, 10.5}, {7.9, 0, 10.5}, {7.8, 0, 10.5}, {5.5, 0, 10.5}});  // but for the first not shown
  car = planted.car();
  CHECK(car.lidar_inside == 1);
  CHECK(car.lidar_outside == 0);
  planted.log.sweeps[0].step = 1;
  CHECK_FALSE(planted.car().has_lidar());
}

TEST_CASE("points move with the actor from the sweep to the image") {
  Planted planted;
  planted.log.actors[0].boxes.push_back({1, 0.1, toy_pose(1, 0, 11)});  // 10 m/s
  planted.log.frames[0].timestamp = 0.05;
  const PixelBox then{35, 20, 75, 60};
  planted.see([&](int column, int row) { return in_box(column, row, then); });
  planted.put_points({{-1.9, 0, 10.1}, {-1.9, 1, 10.1}, {-1.8, 0, 10.1}, {1.9, 0, 10.1}});
  const ObjectView car = planted.car();
  CHECK(car.box == then);
  CHECK(car.lidar_inside == 4);
  CHECK(car.lidar_outside == 0);
  planted.put_points({{2.4, 0, 10.1}});  // in the box of the image's time alone
  CHECK_FALSE(planted.car().has_lidar());
}

TEST_CASE("a mask of 100 pixels is kept, one of 99 is rejected") {
  Planted planted;
  for (const int pixels : {99, 100}) {
    planted.see([&](int column, int row) {
      return (row == 30 && column >= 30 && column < 69) ||
             (row == 31 && column >= 30 && column < 30 + pixels - 39 - 30) ||
             (row == 32 && column >= 30 && column < 60);
    });
    CHECK(planted.car().pixels == pixels);
    CHECK((planted.car().outcome == ObjectOutcome::kept) == (pixels == 100));
  }
  CHECK(planted.car({.least_pixels = 101}).outcome == ObjectOutcome::few_pixels);
  // Pixels that lie elsewhere would not be in the crop.
  planted.see([](int column, int row) { return column < 20 && row < 20; });
  CHECK(planted.car().outcome == ObjectOutcome::few_pixels);
}

TEST_CASE("nearer boxes may cover half of the box, no more, and in training only") {
  const ObjectFilters training{.training = true};
  Planted planted;
  Scene& log = planted.log;
  log.actors.push_back(in_front("near", 30, 50));
  CHECK(planted.car(training).covered == 0.5);
  CHECK(planted.car(training).outcome == ObjectOutcome::kept);
  log.actors[1] = in_front("near", 30, 51);
  CHECK(planted.car(training).covered == 21 / 40.);
  CHECK(planted.car(training).outcome == ObjectOutcome::covered);
  CHECK(planted.car().outcome == ObjectOutcome::kept);
  CHECK(planted.all(training).objects.at(1).covered == 0);  // the car does not cover what is in front of it
  log.actors[1].label = "Signs";                            // of no class, but in the way
  CHECK(planted.car(training).outcome == ObjectOutcome::covered);
  log.actors[1] = actor_at("far", {0, 0, 21}, {40, 40, 2});
  CHECK(planted.car(training).outcome == ObjectOutcome::kept);
  log.actors[1] = in_front("near", 30, 46);  // 16 columns and 16, of which 12 are common: 20
  log.actors.push_back(in_front("other", 34, 50));
  CHECK(planted.car(training).covered == 0.5);
  CHECK(planted.car(training).outcome == ObjectOutcome::kept);
}

TEST_CASE("the first filter that rejects an object is told") {
  Planted planted;
  planted.log.actors.push_back(in_front("near", 30, 70));
  planted.put_points(points(0, 3));
  planted.see([](int, int) { return false; });
  const ObjectFilters training{.training = true};
  CHECK(planted.car(training).outcome == ObjectOutcome::lidar_outside);
  planted.put_points({});
  CHECK(planted.car(training).outcome == ObjectOutcome::few_pixels);
  planted.see([](int column, int) { return column < 50; });
  CHECK(planted.car(training).outcome == ObjectOutcome::covered);
}

TEST_CASE("masks from elsewhere: their folder, their numbers, and what is wrong with them") {
  Planted planted;
  const fs::path sam = planted.folder.path / "sam";
  const std::string missing = error_of([&] { ActorMasks::from(planted.log, sam); });
  CHECK_MESSAGE(holds(missing, "no " + (sam / "actors.json").string()), missing);
  commit_text(sam / "actors.json", R"({"300": "car"})");
  const ActorMasks without = ActorMasks::from(planted.log, sam);
  CHECK_FALSE(without.has_truth(planted.log.frames[0]));  // the log's own truth is not asked
  Labels labels{kWidth, kHeight, std::vector<std::uint16_t>(kWidth * kHeight)};
  labels.values[5] = 300;
  write_labels(sam / "front_camera/00_actor.png", labels);
  const ActorMask mask = ActorMasks::from(planted.log, sam).of(planted.log.frames[0], planted.log.cameras[0]);
  CHECK(mask.actors[5] == 1);
  CHECK(std::count(mask.actors.begin(), mask.actors.end(), 0) == kWidth * kHeight - 1);
  write_labels(sam / "front_camera/00_actor.png", {50, kHeight, std::vector<std::uint16_t>(50 * kHeight)});
  const std::string size =
      error_of([&] { ActorMasks::from(planted.log, sam).of(planted.log.frames[0], planted.log.cameras[0]); });
  CHECK_MESSAGE(holds(size, "00_actor.png: the mask has 50x80 pixels"), size);
  planted.log.frames[0].sensor = "../..";
  CHECK(holds(error_of([&] { ActorMasks::from(planted.log, sam).has_truth(planted.log.frames[0]); }), "leaves"));
}

namespace {

/// The pixels of a canvas, twice as wide and high as the image and about the same middle, whose rays meet the box; in
/// pixels of the image.
PixelBox pixels_met(const Camera& camera, const Eigen::Matrix4d& camera_from_box, const Eigen::Vector3d& size) {
  Camera canvas = camera;
  canvas.width *= 2, canvas.height *= 2;
  canvas.cx += 0.5 * camera.width, canvas.cy += 0.5 * camera.height;
  const ActorMask mask = outlines({{1, size, camera_from_box}}, canvas, Eigen::Matrix4d::Identity());
  PixelBox met{canvas.width, canvas.height, 0, 0};
  for (int row = 0; row < canvas.height; ++row)
    for (int column = 0; column < canvas.width; ++column) {
      if (!mask.actors[std::size_t(row * canvas.width + column)]) continue;
      met = {std::min(met.left, column), std::min(met.top, row), std::max(met.right, column + 1),
             std::max(met.bottom, row + 1)};
    }
  const int left = camera.width / 2, top = camera.height / 2;
  return {met.left - left, met.top - top, met.right - left, met.bottom - top};
}

bool leaves_canvas(const Camera& camera, const PixelBox& met) {
  return met.left == -camera.width / 2 || met.top == -camera.height / 2 || met.right == camera.width * 3 / 2 ||
         met.bottom == camera.height * 3 / 2;
}

/// A box of any direction and place about the camera, but not about its lens.
struct AnyBox {
  explicit AnyBox(HostRandom& random) {
    const Eigen::Matrix3d turn = (Eigen::AngleAxisd(random.between(0, 6), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(random.between(0, 6), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    const double x = random.between(-6, 6), y = random.between(-4, 4);
    camera_from_box = pose_from(turn, {x, y, random.between(-2, 14)});
    size = {random.between(1, 3), random.between(2, 9), random.between(1, 3)};
  }
  bool is_at_lens() const {
    const Eigen::Vector3d eye = camera_from_box.inverse().topRightCorner<3, 1>();
    return (eye.cwiseAbs() - 0.5 * size).maxCoeff() < 0.2;
  }
  Eigen::Matrix4d camera_from_box;
  Eigen::Vector3d size;
};

}  // namespace

TEST_CASE("the bounds of projected boxes are those of the pixels whose rays meet them, through every lens") {
  const Camera lenses[] = {{120, 90, 70, 70, 60, 45},
                           {120, 90, 70, 70, 60, 45, CameraModel::opencv, {-0.2, 0.03, 0, 0}, 0.001, -0.001},
                           {120, 90, 60, 60, 60, 45, CameraModel::fisheye, {0.02, 0, 0, 0}},
                           {120, 90, 80, 80, 60, 45, CameraModel::fov, {0.9, 0, 0, 0}}};
  HostRandom random(5);
  int whole = 0, cut = 0;
  for (const Camera& camera : lenses)
    for (int trial = 0; trial < 100; ++trial) {
      CAPTURE(static_cast<int>(camera.model));
      CAPTURE(trial);
      const AnyBox any(random);
      const PixelBox met = pixels_met(camera, any.camera_from_box, any.size);
      const bool in_image = met.left < camera.width && met.right > 0 && met.top < camera.height && met.bottom > 0;
      if (!in_image || any.is_at_lens()) continue;
      const auto box = bounds_in_image(camera, any.camera_from_box, any.size);
      REQUIRE(box);
      // Where corners are sharp, no ray goes through the last pixels.
      const bool leaves = leaves_canvas(camera, met);
      const auto agrees = [&](int inner, int found, int count) {
        const int more = std::clamp(inner, 0, count) - found;
        return more >= 0 && (leaves || more <= 4);
      };
      CHECK(agrees(met.left, box->left, camera.width));
      CHECK(agrees(met.top, box->top, camera.height));
      CHECK(agrees(camera.width - met.right, camera.width - box->right, camera.width));
      CHECK(agrees(camera.height - met.bottom, camera.height - box->bottom, camera.height));
      ++(leaves ? cut : whole);
    }
  CHECK(whole > 100);
  CHECK(cut > 30);
}

TEST_CASE("the share of a box that others cover is that of its pixels") {
  HostRandom random(9);
  const auto any_box = [&] {
    const int left = int(random.between(0, 30)), top = int(random.between(0, 30));
    return PixelBox{left, top, left + int(random.between(1, 15)), top + int(random.between(1, 15))};
  };
  for (int trial = 0; trial < 200; ++trial) {
    const PixelBox box = any_box();
    std::vector<PixelBox> others;
    for (int i = 0; i < trial % 7; ++i) others.push_back(any_box());
    int covered = 0;
    for (int row = box.top; row < box.bottom; ++row)
      for (int column = box.left; column < box.right; ++column)
        covered += std::any_of(others.begin(), others.end(), [&](const auto& o) { return in_box(column, row, o); });
    CHECK(covered_share(box, others) == covered / static_cast<double>(box.area()));
  }
}

namespace {

struct Shifted {
  int kept = 0, rejected = 0;
};

/// The mask of one actor, moved sideways by half of its 2-D box, as a mask file of its own.
void write_shifted(const fs::path& path, const ActorMask& mask, const ObjectView& object, int direction) {
  const int shift = direction * (object.box.width() + 1) / 2;
  Labels labels{mask.width, mask.height, std::vector<std::uint16_t>(mask.actors.size())};
  for (int row = 0; row < mask.height; ++row)
    for (int column = 0; column < mask.width; ++column) {
      const int from = column - shift;
      const bool seen =
          from >= 0 && from < mask.width && mask.actors[std::size_t(row * mask.width + from)] == int(object.actor) + 1;
      labels.values[std::size_t(row * mask.width + column)] = seen;
    }
  write_labels(path, labels);
}

/// Of all objects that are kept with the log's masks, those that are rejected with shifted ones.
Shifted shift_masks(const Scene& log) {
  const Folder folder;
  const ActorMasks truth(log);
  ObjectFinder finder(log, truth, {});
  Shifted result;
  Scene single = log;
  for (std::size_t index = 0; index < log.frames.size(); ++index) {
    single.frames = {log.frames[index]};
    Pixels pixels = load_images(single, log.frames[index].split);
    FramePixels& photo = pixels.frames.at(0);
    photo.frame = index;
    const ObjectsInImage found = finder.objects(photo, pixels.cameras[0]);
    for (const ObjectView& object : found.objects) {
      if (object.outcome != ObjectOutcome::kept) continue;
      const Frame& frame = log.frames[index];
      commit_text(folder.path / "actors.json", "{\"1\": \"" + log.actors[object.actor].id + "\"}");
      const std::string name = fs::path(frame.image).stem().string() + "_actor.png";
      write_shifted(folder.path / frame.sensor / name, found.mask, object, result.kept % 2 == 0 ? 1 : -1);
      const ActorMasks wrong = ActorMasks::from(log, folder.path);
      ObjectFinder again(log, wrong, {});
      for (const ObjectView& same : again.objects(photo, pixels.cameras[0]).objects)
        if (same.actor == object.actor) result.rejected += same.outcome != ObjectOutcome::kept;
      ++result.kept;
    }
  }
  return result;
}

}  // namespace

TEST_CASE("masks that are half a box beside are rejected") {
  const Folder folder;
  write_street_log(folder.path / "001", {.frames = 3, .width = 320, .height = 180, .seed = 4});
  const Shifted made = shift_masks(read_scene(folder.path / "001"));
  CHECK(made.kept > 20);
  CHECK(made.rejected >= 0.95 * made.kept);
  const fs::path mini = test_data("pandaset-mini/001");
  if (no_data(mini)) return;
  const Shifted other = shift_masks(read_scene(mini));
  CHECK(other.kept > 150);
  CHECK(other.rejected >= 0.95 * other.kept);
}
