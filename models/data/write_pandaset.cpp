// See write_pandaset.h.
#include "models/data/write_pandaset.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "models/data/data_frame.h"
#include "models/data/pandaset.h"
#include "models/data/pose_track.h"
#include "models/data/recording_file.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kFullIntensity = 255;
constexpr double kUpright = 1e-6;  // radians that boxes may be tilted by and count as upright

void write_json(const fs::path& path, const Json& json) { commit_text(path, json.dump(1) + "\n"); }

struct Moment {
  double time = 0;
  Eigen::Matrix4d world_from_sensor = Eigen::Matrix4d::Identity();
};

// poses.json and timestamps.json have an entry for each step from 0 on; gaps repeat what is before them (or after).
void write_track(const fs::path& folder, const std::map<int, Moment>& moments) {
  Json poses = Json::array(), times = Json::array();
  if (moments.empty()) return;
  for (int step = 0; step <= moments.rbegin()->first; ++step) {
    const auto after = moments.upper_bound(step);
    const Moment& moment = (after == moments.begin() ? after : std::prev(after))->second;
    poses.push_back(pose_entry(moment.world_from_sensor));
    times.push_back(moment.time);
  }
  write_json(folder / "poses.json", poses);
  write_json(folder / "timestamps.json", times);
}

void write_intrinsics(const fs::path& folder, const Camera& camera) {
  write_json(folder / "intrinsics.json", {{"fx", camera.fx}, {"fy", camera.fy}, {"cx", camera.cx}, {"cy", camera.cy}});
}

void write_camera_tracks(const fs::path& root, const Scene& log) {
  std::map<std::string, std::map<int, Moment>> tracks;
  for (const Frame& frame : log.frames) {
    const fs::path folder = root / "camera" / frame.sensor;
    const Camera& camera = log.cameras.at(static_cast<std::size_t>(frame.camera));
    auto& track = tracks[frame.sensor];
    // Those of the image that a reader takes the size from.
    if (track.empty() || frame.step < track.begin()->first) write_intrinsics(folder, camera);
    track[frame.step] = {frame.timestamp.value_or(0), frame.world_from_camera};
  }
  for (const auto& [sensor, track] : tracks) write_track(root / "camera" / sensor, track);
}

DataFrame sweep_frame(const LidarPoints& points, double timestamp) {
  DataFrame frame;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (std::size_t i = 0; i < points.size(); ++i) values.push_back(points.positions[3 * i + std::size_t(axis)]);
    frame.add({std::string(1, "xyz"[axis]), std::move(values)});
  }
  std::vector<double> intensities, times;
  for (const float value : points.intensities) intensities.push_back(std::round(value * kFullIntensity));
  for (const float value : points.times) times.push_back(timestamp + value);
  frame.add({"i", std::move(intensities)});
  frame.add({"t", std::move(times)});
  frame.add({"d", std::vector<std::int64_t>(points.sensors.begin(), points.sensors.end())});
  return frame;
}

void write_lidar_track(const fs::path& root, const Scene& log) {
  std::map<int, Moment> track;
  for (const Sweep& sweep : log.sweeps) track[sweep.step] = {sweep.timestamp, sweep.world_from_lidar};
  write_track(root / "lidar", track);
}

bool has_tilted_boxes(const Scene& log) {
  return std::ranges::any_of(log.actors, [](const Actor& actor) {
    return std::ranges::any_of(actor.boxes, [](const ActorBox& box) {
      const CuboidTurn turn = cuboid_turn(box.world_from_box);
      return std::max(std::abs(turn.pitch), std::abs(turn.roll)) > kUpright;
    });
  });
}

// The cuboids of one step, a column at a time.
DataFrame cuboid_frame(const Scene& log, int step, bool tilted) {
  std::vector<std::string> ids, labels, motions;
  std::vector<double> yaws, pitches, rolls;
  std::vector<double> positions[3], sizes[3];
  std::vector<std::uint8_t> stationary;
  for (const Actor& actor : log.actors) {
    const ActorBox* box = box_at_step(actor, step);
    if (!box) continue;
    ids.push_back(actor.id);
    labels.push_back(actor.label);
    motions.push_back(actor.stationary ? "Parked" : "Moving");
    stationary.push_back(actor.stationary);
    const CuboidTurn turn = cuboid_turn(box->world_from_box);
    yaws.push_back(turn.yaw);
    pitches.push_back(turn.pitch);
    rolls.push_back(turn.roll);
    for (int axis = 0; axis < 3; ++axis) {
      positions[axis].push_back(box->world_from_box(axis, 3));
      sizes[axis].push_back(actor.size[axis]);
    }
  }
  const std::size_t rows = ids.size();
  DataFrame frame;
  frame.add({"uuid", std::move(ids)});
  frame.add({"label", std::move(labels)});
  frame.add({"yaw", std::move(yaws)});
  if (tilted) {
    frame.add({"pitch", std::move(pitches)});
    frame.add({"roll", std::move(rolls)});
  }
  frame.add({"stationary", std::move(stationary)});
  frame.add({"camera_used", std::vector<std::int64_t>(rows, -1)});
  for (int axis = 0; axis < 3; ++axis) frame.add({std::string("position.") + "xyz"[axis], std::move(positions[axis])});
  for (int axis = 0; axis < 3; ++axis) frame.add({std::string("dimensions.") + "xyz"[axis], std::move(sizes[axis])});
  frame.add({"attributes.object_motion", std::move(motions)});
  frame.add({"cuboids.sibling_id", std::vector<std::string>(rows, "-")});
  frame.add({"cuboids.sensor_id", std::vector<std::int64_t>(rows, -1)});  // seen by one LiDAR
  return frame;
}

// gps.json has a place on Earth for each step; the log says none, and stands at 0, 0.
void write_meta(const fs::path& root, const Scene& log, const std::map<int, double>& times) {
  Json gps = Json::array(), stamps = Json::array();
  for (const auto& [step, time] : times) {
    gps.push_back({{"lat", 0.0}, {"long", 0.0}, {"height", 0.0}, {"xvel", 0.0}, {"yvel", 0.0}});
    stamps.push_back(time);
  }
  write_json(root / "meta" / "gps.json", gps);
  write_json(root / "meta" / "timestamps.json", stamps);
  write_json(root / "meta" / "time_of_day.json", {{"night", log.night}});
  if (log.recording != Recording{}) write_json(root / kRecordingFile, to_json(log.recording));
}

}  // namespace

void write_pandaset_image(const fs::path& root, const Scene& log, const Frame& frame, const Image& image) {
  const fs::path folder = root / "camera" / frame.sensor;
  const Camera& camera = log.cameras.at(static_cast<std::size_t>(frame.camera));
  if (camera.model != CameraModel::pinhole) {
    throw Error(Fault::usage,
                text(folder.string(), ": PandaSet's layout has only pinhole cameras; this one has lens distortion"));
  }
  if (image.width != camera.width || image.height != camera.height) {
    throw Error(Fault::internal, text(frame.name, ": an image of ", image.width, "x", image.height, ", its camera has ",
                                      camera.width, "x", camera.height));
  }
  write_jpeg(folder / (pandaset_number(frame.step) + ".jpg"), image);
}

void write_pandaset_sweep(const fs::path& root, const Sweep& sweep, const LidarPoints& points) {
  const fs::path path = root / "lidar" / (pandaset_number(sweep.step) + ".pkl.gz");
  write_data_frame(path, sweep_frame(points, sweep.timestamp));
}

void write_pandaset_rest(const fs::path& root, const Scene& log) {
  write_camera_tracks(root, log);
  write_lidar_track(root, log);
  std::map<int, double> times;
  for (const Sweep& sweep : log.sweeps) times.emplace(sweep.step, sweep.timestamp);
  for (const Frame& frame : log.frames) times.emplace(frame.step, frame.timestamp.value_or(0));
  const bool tilted = has_tilted_boxes(log);
  for (const auto& [step, time] : times) {
    write_data_frame(root / "annotations" / "cuboids" / (pandaset_number(step) + ".pkl.gz"),
                     cuboid_frame(log, step, tilted));
  }
  write_meta(root, log, times);
}

void write_pandaset(const fs::path& root, const Scene& log, const LogContent& content) {
  for (const Frame& frame : log.frames) write_pandaset_image(root, log, frame, content.image(frame));
  for (const Sweep& sweep : log.sweeps) write_pandaset_sweep(root, sweep, content.points(sweep));
  write_pandaset_rest(root, log);
}

}  // namespace cloam
