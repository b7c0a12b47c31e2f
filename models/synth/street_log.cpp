// See street_log.h.
#include "models/synth/street_log.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>

#include "models/data/pandaset.h"
#include "models/data/write_pandaset.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "models/synth/as_recorded.h"
#include "models/synth/procedural.h"
#include "models/synth/street_sensors.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kStart = 1557539924;
constexpr double kLongest = 20;      // seconds
constexpr double kFarthestBox = 80;  // metres from the car
constexpr double kMostSway = 20;     // degrees
constexpr double kMostAside = 3;     // metres
constexpr int kTurns = 8;

void check(const StreetLogOptions& options) {
  const bool sound = options.frames >= 1 && options.frames <= 200 && options.width >= 16 && options.width <= 4096 &&
                     options.height >= 16 && options.height <= 4096 && options.beams >= 1 && options.beams <= 256 &&
                     !options.cameras.empty() && options.clouds >= 0 && options.clouds <= 1 && options.sway >= 0 &&
                     options.sway <= kMostSway && std::abs(options.aside) <= kMostAside;
  if (!sound) {
    throw Error(
        Fault::usage,
        text("a synthetic log has 1 to 200 frames, pictures of 16 to 4096 pixels per side, 1 to 256 beams, at least "
             "one camera, clouds of 0 to 1, a sway of 0 to 20 degrees, actors at most 3 m aside; got ",
             options.frames, ", ", options.width, "x", options.height, ", ", options.beams, ", ",
             options.cameras.size(), ", ", options.clouds, ", ", options.sway, " and ", options.aside));
  }
  if (options.dead_lidar && !options.as_recorded)
    throw Error(Fault::usage, "dead LiDAR poses are of logs that are made as recorded");
  const bool paced = options.rate >= 1 && options.rate <= 10 && options.frames <= kLongest * options.rate;
  if (paced) return;
  throw Error(Fault::usage, text("a synthetic log has 1 to 10 frames per second and lasts at most ", kLongest,
                                 " seconds; got ", options.frames, " frames at ", options.rate, " per second"));
}

/// [height, width] of float16 as numpy saves it; numpy.lib.format, version 1.
void write_half_npy(const fs::path& path, const std::vector<float>& values, int width, int height) {
  std::string head = text("{'descr': '<f2', 'fortran_order': False, 'shape': (", height, ", ", width, "), }");
  constexpr std::size_t kPreamble = 10, kAlign = 64;
  head.resize((kPreamble + head.size() + 1 + kAlign - 1) / kAlign * kAlign - kPreamble, ' ');
  head.back() = '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(head.size() & 0xff);
  bytes += static_cast<char>(head.size() >> 8);
  bytes += head;
  for (const float value : values) {
    const auto bits = Eigen::numext::bit_cast<std::uint16_t>(Eigen::half(value));
    bytes += static_cast<char>(bits & 0xff);
    bytes += static_cast<char>(bits >> 8);
  }
  commit_text(path, bytes);
}

class StreetLog {
 public:
  StreetLog(const fs::path& root, const StreetLogOptions& options, const std::function<void()>& on_picture)
      : root_(root),
        options_(options),
        on_picture_(on_picture),
        recording_(recording_of(options)),
        street_(make_street(options.seed, {options.night, options.clouds}, options.frames / options.rate)) {
    street_.sway = options.sway;
    for (StreetActor& actor : street_.world.actors)
      if (!actor.parked) actor.track.right += options.aside * std::cos(actor.track.turn);
  }

  void write() {
    const Scene log = describe();
    write_pandaset(root_, log,
                   {[&](const Frame& frame) { return picture_of(log, frame); },
                    [&](const Sweep& sweep) { return sweep_of(sweep.step); }});
    if (options_.truth) write_actor_names();
    for (const Frame& frame : log.frames) {
      if (options_.truth && frame.sensor == kPandasetCameras[0]) write_turned(log, frame);
    }
  }

 private:
  double time_of(int step) const { return step / options_.rate; }

  Scene describe() const {
    Scene log;
    log.is_log = log.metric = true;
    log.night = options_.night;
    log.recording = recording_;
    for (const std::string& name : options_.cameras) {
      const Mount& mount = mount_of(name);
      const double focal = mount.focal * options_.width;
      Camera camera;
      camera.width = options_.width;
      camera.height = options_.height;
      camera.fx = camera.fy = focal;
      camera.cx = 0.5 * options_.width;
      camera.cy = 0.5 * options_.height;
      const int index = find_or_add(log.cameras, camera);
      for (int step = 0; step < options_.frames; ++step) {
        Frame frame;
        frame.sensor = name;
        frame.step = step;
        frame.camera = index;
        const double stamp = time_of(step) + exposed_after(options_, mount) + recording_.image_stamp;
        frame.timestamp = kStart + stamp;
        frame.world_from_camera = world_from_camera(street_, mount, stamp);
        log.frames.push_back(std::move(frame));
      }
    }
    for (int step = 0; step < options_.frames; ++step) {
      const double stamp = time_of(step) + recording_.sweep_stamp,
                   posed = options_.dead_lidar ? recording_.sweep_stamp : stamp;
      log.sweeps.push_back({"", kStart + stamp, world_from_lidar(street_, posed), step, Split::train});
    }
    for (const StreetActor& actor : street_.world.actors) log.actors.push_back(boxes_of(actor));
    return log;
  }

  Actor boxes_of(const StreetActor& made) const {
    Actor actor;
    actor.id = made.id;
    actor.label = made.label;
    actor.size = made.thing->bounds.sizes();
    actor.stationary = made.parked;
    for (int step = 0; step < options_.frames; ++step) {
      const double time = seen_time(street_, made, time_of(step), recording_);
      const PlacedThing placed = made.at(street_.world.course, time, 0, 0);
      const Eigen::Vector3d ego = world_from_ego(street_, time).topRightCorner<3, 1>();
      if ((placed.position - ego).norm() > kFarthestBox) continue;
      ActorBox box{step, kStart + time_of(step)};
      box.world_from_box.topLeftCorner<2, 2>() << placed.turn.x(), -placed.turn.y(), placed.turn.y(), placed.turn.x();
      box.world_from_box.topRightCorner<3, 1>() = placed.position + Eigen::Vector3d(0, 0, 0.5 * actor.size.z());
      actor.boxes.push_back(box);
    }
    return actor;
  }

  StreetPicture take(const Scene& log, const Frame& frame, double turn) const {
    Exposure exposure;
    exposure.mount = &mount_of(frame.sensor);
    exposure.camera = log.cameras[std::size_t(frame.camera)];
    exposure.time = time_of(frame.step) + exposed_after(options_, *exposure.mount);
    exposure.duration = recording_.shutter;
    exposure.turn = turn;
    StreetPicture picture = take_picture(street_, exposure);
    const auto covered = recording_.car_rows.find(frame.sensor);
    if (covered != recording_.car_rows.end()) cover_rows(picture, covered->second);
    if (on_picture_) on_picture_();
    return picture;
  }

  Image picture_of(const Scene& log, const Frame& frame) const {
    const StreetPicture picture = take(log, frame, 0);
    if (options_.truth) {
      const fs::path stem = root_ / "truth" / frame.sensor / pandaset_number(frame.step);
      write_actors(stem, picture);
      write_half_npy(stem.string() + "_depth.npy", picture.depth, picture.image.width, picture.image.height);
    }
    return picture.image;
  }

  static void write_actors(const fs::path& stem, const StreetPicture& picture) {
    write_png(stem.string() + "_actor.png", {picture.image.width, picture.image.height, 1, picture.actor});
  }

  LidarPoints sweep_of(int step) const {
    Spin spin;
    spin.beams = options_.beams;
    spin.time = time_of(step);
    spin.moving = recording_.sweep_seconds > 0;
    spin.seed = mixed(options_.seed) + std::uint64_t(step);
    spin.car = recording_.car;
    LidarPoints points = take_sweep(street_, spin);
    if (recording_.second_lidar) add_ahead(street_, spin, *recording_.second_lidar, points);
    for (float& time : points.times) time -= static_cast<float>(recording_.sweep_stamp);
    return points;
  }

  void write_actor_names() const {
    Json names = Json::object();
    for (std::size_t i = 0; i < street_.world.actors.size(); ++i) {
      names[std::to_string(i + 1)] = street_.world.actors[i].id;
    }
    commit_text(root_ / "truth" / "actors.json", names.dump(1) + "\n");
  }

  void write_turned(const Scene& log, const Frame& frame) const {
    for (int turn = 1; turn < kTurns; ++turn) {
      const std::string degrees = std::to_string(1000 + 45 * turn).substr(1);
      const fs::path stem = root_ / "truth" / ("rot" + degrees) / frame.sensor / pandaset_number(frame.step);
      const StreetPicture picture = take(log, frame, turn * M_PI / 4);
      write_jpeg(stem.string() + ".jpg", picture.image);
      write_actors(stem, picture);
    }
  }

  fs::path root_;
  StreetLogOptions options_;
  std::function<void()> on_picture_;
  Recording recording_;
  MadeStreet street_;
};

bool sees_front(const StreetLogOptions& options) {
  return std::find(options.cameras.begin(), options.cameras.end(), kPandasetCameras[0]) != options.cameras.end();
}

}  // namespace

std::uint64_t street_log_seed(std::uint64_t seed, int log) { return mixed(mixed(seed) + std::uint64_t(log)); }

bool street_log_night(std::uint64_t seed, int log, double probability) {
  const double start = HostRandom(mixed(seed) ^ 0x6e69676874).between(0, 1);
  return std::floor(start + (log + 1) * probability) > std::floor(start + log * probability);
}

int street_log_pictures(const StreetLogOptions& options) {
  const int turned = options.truth && sees_front(options) ? kTurns - 1 : 0;
  return options.frames * (static_cast<int>(options.cameras.size()) + turned);
}

void write_street_log(const fs::path& root, const StreetLogOptions& options, const std::function<void()>& on_picture) {
  check(options);
  StreetLog(root, options, on_picture).write();
}

}  // namespace cloam
