// Boxes that are learned: how they accelerate, against difference quotients on the host; where rays meet them and what
// their samples' places say of them, against float64; that shifted boxes come back; and the log that is written.
#include <doctest/doctest.h>

#include <cmath>

#include "models/data/data_frame.h"
#include "models/data/refined_log.h"
#include "models/methods/box_refinement.h"
#include "models/methods/registry.h"
#include "models/scene/pose.h"
#include "models/street/followed_rays.h"
#include "models/street/refines_boxes.h"
#include "runtime/ops.h"
#include "tests/models/errors.h"
#include "tests/models/learned_cameras.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// A car that turns and brakes; its boxes come at uneven times, and one is missing.
Actor braking_car() {
  Actor car{"a", "Car", {2, 4, 1.5}, false, {}};
  for (const int step : {0, 1, 2, 3, 5, 6, 7}) {
    const double t = 0.1 * step + 0.01 * std::sin(7.0 * step);
    car.boxes.push_back(
        {step, t, pose_from(turn_about_z(0.4 * t), {500 + 8 * t - 1.5 * t * t, 0.7 * t * t, 0.2 * std::sin(3 * t)})});
  }
  return car;
}

/// Over the boxes with one before and one behind them: the mean square, from places in double precision.
double mean_square_acceleration(const Actor& car) {
  double total = 0;
  int count = 0;
  for (std::size_t b = 1; b + 1 < car.boxes.size(); ++b) {
    const ActorBox &first = car.boxes[b - 1], &second = car.boxes[b], &third = car.boxes[b + 1];
    if (third.step != first.step + 2) continue;
    const auto place = [](const ActorBox& box) { return Vector3d(box.world_from_box.topRightCorner<3, 1>()); };
    const Vector3d before = (place(second) - place(first)) / (second.timestamp - first.timestamp),
                   after = (place(third) - place(second)) / (third.timestamp - second.timestamp);
    total += ((after - before) / ((third.timestamp - first.timestamp) / 2)).squaredNorm();
    ++count;
  }
  return total / count;
}

}  // namespace

TEST_CASE("boxes' accelerations are those of the places to which shifts and turns move them") {
  const std::vector<Actor> actors = {braking_car()};
  Params parameters;
  BoxRefinement boxes;
  Scene scene;
  scene.actors = actors;
  boxes.build({.refine = true}, scene, parameters);
  CHECK(boxes.square_accelerations().item() == doctest::Approx(mean_square_acceleration(actors[0])).epsilon(1e-4));

  std::vector<float> shifts, yaws;
  for (int i = 0; i < 7; ++i) {
    for (int k = 0; k < 3; ++k) shifts.push_back(static_cast<float>(0.3 * std::sin(5 * i + 2 * k)));
    yaws.push_back(static_cast<float>(0.05 * i));
  }
  assign({{parameters.at(kPositionsName), from_host(shifts, {7, 3})},
          {parameters.at(kYawsName), from_host(yaws, {7, 1})}});
  const std::vector<Actor> learned = boxes.refined(actors);
  REQUIRE(learned.size() == 1);
  for (std::size_t b = 0; b < 7; ++b) {
    const Eigen::Matrix4d &given = actors[0].boxes[b].world_from_box, &moved = learned[0].boxes[b].world_from_box;
    const Vector3d by(shifts[3 * b], shifts[3 * b + 1], shifts[3 * b + 2]);
    const double yaw = std::atan2(given(1, 0), given(0, 0)), turned = std::atan2(moved(1, 0), moved(0, 0));
    CHECK(turned == doctest::Approx(yaw + yaws[b]));
    const Vector3d place(given(0, 3) + std::cos(yaw) * by.x() - std::sin(yaw) * by.y(),
                         given(1, 3) + std::sin(yaw) * by.x() + std::cos(yaw) * by.y(), given(2, 3) + by.z());
    CHECK((moved.topRightCorner<3, 1>() - place).norm() < 1e-6);
  }
  CHECK(boxes.square_accelerations().item() == doctest::Approx(mean_square_acceleration(learned[0])).epsilon(1e-4));
  double length = 0;
  for (std::size_t b = 0; b < 7; ++b) length += std::hypot(shifts[3 * b], shifts[3 * b + 1], shifts[3 * b + 2]) / 7;
  CHECK(boxes.figures().at(0).value() == doctest::Approx(length));

  std::vector<Actor> placed = actors;
  placed[0].follows_path = true;  // by an edit: it stands where the path says
  const std::vector<Actor> kept = boxes.refined(placed);
  for (std::size_t b = 0; b < 7; ++b) CHECK(kept[0].boxes[b].world_from_box == placed[0].boxes[b].world_from_box);
  for (const double time : {placed[0].boxes[0].timestamp, placed[0].boxes[3].timestamp + 0.01})
    for (const auto& [row, share] : boxes.parts_at(0, placed[0], time)) CHECK(share == 0);
}

TEST_CASE("boxes of steps that were held out are moved as those before and after them that train") {
  Scene scene;
  scene.actors = {braking_car()};
  const std::vector<ActorBox>& given = scene.actors[0].boxes;
  for (const ActorBox& box : given) {
    Frame frame;
    frame.step = box.step;
    frame.split = box.step == 1 || box.step == 5 ? Split::train : Split::test;
    scene.frames.push_back(frame);
  }
  Params parameters;
  BoxRefinement boxes;
  boxes.build({.refine = true}, scene, parameters);
  std::vector<float> shifts(21, 9.f), yaws(7, 9.f);  // which nothing may read
  const auto learn = [&](size_t row, float shift, float yaw) {
    for (size_t k = 0; k < 3; ++k) shifts[3 * row + k] = shift * static_cast<float>(k + 1);
    yaws[row] = yaw;
  };
  learn(1, 0.1f, 0.02f);   // step 1
  learn(4, -0.2f, 0.05f);  // step 5
  assign({{parameters.at(kPositionsName), from_host(shifts, {7, 3})},
          {parameters.at(kYawsName), from_host(yaws, {7, 1})}});
  const std::vector<Actor> learned = boxes.refined(scene.actors);
  for (std::size_t b = 0; b < given.size(); ++b) {
    const double way =
        std::clamp((given[b].timestamp - given[1].timestamp) / (given[4].timestamp - given[1].timestamp), 0.0, 1.0);
    const Eigen::Matrix4d by = given[b].world_from_box.inverse() * learned[0].boxes[b].world_from_box;
    CAPTURE(b);
    CHECK(std::atan2(by(1, 0), by(0, 0)) == doctest::Approx(0.02 + way * 0.03));
    CHECK((by.topRightCorner<3, 1>() - (0.1 - way * 0.3) * Vector3d(1, 2, 3)).norm() < 1e-6);
  }
  CHECK(boxes.square_accelerations().item() == doctest::Approx(mean_square_acceleration(learned[0])).epsilon(1e-4));
}

namespace {

/// Two cars that turn, what was learned of them, and rays at a few times from where a camera could be.
struct LearnedCars {
  static constexpr int64_t kRays = 24;
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 3});
  StreetSpace space;
  Params parameters;
  BoxRefinement boxes;
  RayList rays;
  std::vector<float> shifts, yaws;

  LearnedCars() : space((add_cars(scene), scene), {}) {
    boxes.build({.refine = true}, scene, parameters);
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < 3; ++k) shifts.push_back(static_cast<float>(0.3 * std::sin(5 * i + 2 * k)));
      yaws.push_back(static_cast<float>(0.15 * std::cos(3 * i)));
    }
    assign({{parameters.at(kPositionsName), from_host(shifts, {6, 3})},
            {parameters.at(kYawsName), from_host(yaws, {6, 1})}});
    const std::vector<double> times = {0, 0.1, 0.125, 0.2};
    for (int64_t r = 0; r < kRays; ++r) {
      if (r % 6 == 0) rays.times.push_back(times[static_cast<std::size_t>(r / 6)]);
      rays.add((space.street_from_world() * Vector3d(0, 0.1 * static_cast<double>(r % 6), 1).homogeneous()).head<3>(),
               space.street_from_world().topLeftCorner<3, 3>() *
                   Vector3d(10, r % 2 ? -3 : 3, 0.2 * static_cast<double>(r % 3 - 1)).normalized());
    }
  }
  static void add_cars(Scene& scene) {
    for (const double y : {-3., 3.}) {
      Actor car{std::to_string(y), "Car", {4, 2, 2}, false, {}};
      for (int step = 0; step < 3; ++step)
        car.boxes.push_back({step, 0.1 * step, pose_from(turn_about_z(0.1 * y + 0.2 * step), {10. + step, y, 1})});
      scene.actors.push_back(car);
    }
  }
  StreetBoxes moved() const { return boxes.moved(boxes_of(scene.actors, rays, space), scene.actors, rays.times); }
  /// Where a car is at a time, by what was learned: a host's own arithmetic. by: more, of one row.
  Eigen::Matrix4d learned_pose(std::size_t car, double time, std::size_t row, const Eigen::Vector4d& by) const {
    const double at = time / 0.1;
    const auto before = std::min<std::size_t>(1, static_cast<std::size_t>(at));
    Eigen::Vector4d mixed = Eigen::Vector4d::Zero();  // shift, turn
    for (const std::size_t step : {before, before + 1}) {
      const std::size_t own = 3 * car + step;
      const double share = 1 - std::abs(at - static_cast<double>(step));
      mixed += share * (Eigen::Vector4d(shifts[3 * own], shifts[3 * own + 1], shifts[3 * own + 2], yaws[own]) +
                        (own == row ? by : Eigen::Vector4d::Zero().eval()));
    }
    return *world_from_box_at(scene.actors[car], time) * pose_from(turn_about_z(mixed[3]), mixed.head<3>());
  }
};

}  // namespace

TEST_CASE("boxes that were learned stand where rays meet them, and their samples' places say how they change") {
  const LearnedCars cars;
  const auto sample = [&](const StreetBoxes& boxes) {
    const StreetRays rays = {from_host(cars.rays.origins, {LearnedCars::kRays, 3}),
                             from_host(cars.rays.directions, {LearnedCars::kRays, 3}),
                             full({LearnedCars::kRays, 2}, 0.4f), from_host(cars.rays.moments, {LearnedCars::kRays})};
    return std::pair(rays, street_samples(rays, boxes, cars.space.grid(), {.background = 2, .actor = 0.3f}));
  };
  const StreetBoxes boxes = cars.moved();
  const auto [rays, given] = sample(boxes);
  const StreetSamples found = followed_in_boxes(given, rays, boxes);
  const auto count = static_cast<std::size_t>(found.owners.dim(0));
  REQUIRE(count > 60);
  std::vector<float> weights(3 * count), turned_weights(3 * count);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = static_cast<float>(std::sin(1.7 * static_cast<double>(i)));
    turned_weights[i] = static_cast<float>(std::cos(2.9 * static_cast<double>(i)));
  }
  const Tensor total = sum(found.actor_points * from_host(weights, found.actor_points.shape())) +
                       sum(found.actor_directions * from_host(turned_weights, found.actor_points.shape()));
  const Tensors slopes = grad(total, {cars.parameters.at(kPositionsName), cars.parameters.at(kYawsName)});
  const std::vector<float> by_shift = slopes[0].to_host(), by_yaw = slopes[1].to_host();

  const std::vector<int32_t> offsets = found.offsets.to_host<int32_t>(), rows = found.rows.to_host<int32_t>(),
                             owners = found.owners.to_host<int32_t>();
  const std::vector<float> t = found.t.to_host(), points = given.actor_points.to_host();
  const auto background = static_cast<int32_t>(found.points.dim(0));
  const Eigen::Matrix4d world_from_street = cars.space.street_from_world().inverse();
  double furthest = 0;
  const auto summed = [&](std::size_t row, const Eigen::Vector4d& by) {
    double out = 0;
    for (std::size_t r = 0; r < LearnedCars::kRays; ++r)
      for (auto place = static_cast<std::size_t>(offsets[r]); place < static_cast<std::size_t>(offsets[r + 1]);
           ++place) {
        if (rows[place] < background) continue;
        const auto own = static_cast<std::size_t>(rows[place] - background);
        const auto car = static_cast<std::size_t>(owners[own]);
        const auto vector_of = [&](const std::vector<float>& all) {
          return Vector3d(all[3 * r], all[3 * r + 1], all[3 * r + 2]);
        };
        const double time = cars.rays.times[static_cast<std::size_t>(cars.rays.moments[r])];
        const Eigen::Matrix4d box_from_street = cars.learned_pose(car, time, row, by).inverse() * world_from_street;
        const Vector3d way = vector_of(cars.rays.directions),
                       at = vector_of(cars.rays.origins) + double{t[place]} * way;
        const Vector3d in_cube = double{cube_scale({4, 2, 2})} * (box_from_street * at.homogeneous()).head<3>() +
                                 Vector3d::Constant(0.5),
                       turned = box_from_street.topLeftCorner<3, 3>() * way;
        for (std::size_t k = 0; k < 3; ++k) {
          const auto axis = static_cast<Eigen::Index>(k);
          out += double{weights[3 * own + k]} * in_cube[axis] + double{turned_weights[3 * own + k]} * turned[axis];
          if (by.isZero(0)) furthest = std::max(furthest, std::abs(in_cube[axis] - double{points[3 * own + k]}));
        }
      }
    return out;
  };
  summed(0, Eigen::Vector4d::Zero());
  CHECK(furthest < 1e-5);
  for (std::size_t row = 0; row < 6; ++row)
    for (int k = 0; k < 4; ++k) {
      CAPTURE(row);
      CAPTURE(k);
      const Eigen::Vector4d by = 1e-6 * Eigen::Vector4d::Unit(k);
      const double want = (summed(row, by) - summed(row, -by)) / 2e-6;
      const float slope = k < 3 ? by_shift[3 * row + static_cast<std::size_t>(k)] : by_yaw[row];
      CHECK(std::abs(want) > 1e-3);
      CHECK(std::abs(double{slope} - want) < 1e-3 * std::max(1., std::abs(want)));
    }
}

namespace {

/// Learns the boxes alone of a street whose field is known, from photos that it shows with its boxes elsewhere.
void check_boxes_come_back(const std::string& name, Settings settings, const std::string& prefix,
                           const std::string& rate) {
  const Folder folder;
  Scene street = toy_street(folder.path, {.frames = 3, .width = 64, .height = 48});
  street.actors = {toy_actor("a", {2, 3, 3}, 8, -1.5), toy_actor("b", {2, 3, 3}, 11, 2.5)};
  const auto model = configured(name, settings);
  model->build({street}, 7);
  load_data(*model, street, toy_pixels(street));
  make_painted(*model);
  Scene shifted = street;
  const auto off_by = [&](const std::vector<Actor>& actors) {  // metres, means over the boxes that photos show
    double along = 0, across = 0;
    for (std::size_t a = 0; a < 2; ++a)
      for (std::size_t b = 0; b < 3; ++b) {
        const Eigen::Matrix4d by = actors[a].boxes[b].world_from_box - street.actors[a].boxes[b].world_from_box;
        along += std::abs(by(0, 3)) / 6;
        across += std::hypot(by(1, 3), by(2, 3)) / 6;
      }
    return std::pair(along, across);
  };
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      const double angle = 4. * static_cast<double>(a) + 5. * static_cast<double>(b);
      shifted.actors[a].boxes[b].world_from_box.topRightCorner<3, 1>() +=
          Vector3d(0, 0.3 * std::cos(angle), 0.3 * std::sin(angle));
    }
  settings.insert(settings.end(), {{"actors.refine", "true"}, {"train.rate_positions", rate}});
  const auto method = configured(name, settings);
  method->build({shifted}, 7);
  load_data(*method, shifted, painted(toy_pixels(shifted), *model, street));
  learn_alone(*method, prefix + kPositionsName, *model, 70);
  const auto [never, before] = off_by(shifted.actors);
  const auto [along, across] = off_by(as<RefinesBoxes>(*method)->refined_actors(0));
  MESSAGE(before, " m across the view before, ", across, " after and ", along, " along it");
  CHECK(before == doctest::Approx(0.3));
  CHECK(across < 0.5 * before);
  CHECK(never == 0);
  CHECK(along < 0.3);  // photos alone hardly tell how far away a box is
}

}  // namespace

TEST_CASE("neurad: boxes that were shifted across the view come back") {
  check_boxes_come_back("neurad", painted_neurad(), "", "1e-2");
}

TEST_CASE("genassets: boxes that were shifted across the view come back, from patches and from whole images") {
  check_boxes_come_back("genassets", painted_planes({}), "log0.", "1e-2");
  // A step sees one of the three photos.
  check_boxes_come_back("genassets", painted_planes({{"batch.whole_images", "true"}}), "log0.", "3e-2");
}

TEST_CASE("a log is written with learned boxes: what was not learned stays, byte for byte or value for value") {
  const Folder folder;
  Scene log;
  log.root = folder.path / "given";
  log.format = "PandaSet";
  write_text(folder.path / "elsewhere/00.jpg", "not looked at");
  std::filesystem::create_directories(log.root / "camera");
  std::filesystem::create_directory_symlink(folder.path / "elsewhere", log.root / "camera/front_camera");
  const auto cuboids = [&](const char* name) {
    DataFrame frame;
    frame.add({"uuid", std::vector<std::string>{"a", "b"}});
    frame.add({"yaw", std::vector<double>{0.5, -0.5}});
    for (const char* axis : {"position.x", "position.y", "position.z"}) frame.add({axis, std::vector<double>{1, 2}});
    frame.add({"attributes.rider_status", std::vector<std::string>{"-", "With Rider"}});
    write_data_frame(log.root / "annotations/cuboids" / name, frame);
  };
  cuboids("00.pkl.gz");
  cuboids("01.pkl.gz");
  Actor actor{"b", "Bicycle", {1, 2, 1}, false, {{1, 0.1, pose_from(turn_about_z(0.25), {7, 8, 9})}}};
  write_refined_log(folder.path / "refined", log, {{actor}});

  const std::filesystem::path refined = folder.path / "refined";
  CHECK(content_of(refined / "camera/front_camera/00.jpg") == "not looked at");
  const char* const untouched = "annotations/cuboids/00.pkl.gz";
  CHECK(content_of(refined / untouched) == content_of(log.root / untouched));
  const DataFrame moved = read_data_frame(refined / "annotations/cuboids/01.pkl.gz");
  CHECK(moved.numbers("position.x") == std::vector<double>{1, 7});
  CHECK(moved.numbers("position.y") == std::vector<double>{1, 8});
  CHECK(moved.numbers("position.z") == std::vector<double>{1, 9});
  CHECK(moved.numbers("yaw")[0] == 0.5);
  CHECK(moved.numbers("yaw")[1] == doctest::Approx(0.25));
  CHECK(moved.texts("attributes.rider_status")[1] == "With Rider");

  CHECK(has_room_for({{actor}}, log));
  log.format = "KITTI";
  CHECK_FALSE(has_room_for({{actor}}, log));
}
