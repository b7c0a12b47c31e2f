// See rig.h.
#include "models/data/rig.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "models/data/log_builder.h"
#include "models/data/moments.h"
#include "models/data/poses.h"
#include "models/data/transforms_json.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "models/scene/pose.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFile = "rig.json";

// A list that may be absent.
const Json& entries(const Json& json, const char* key) {
  static const Json nothing = Json::array();
  return json.contains(key) ? array(json, key, kFile) : nothing;
}

Eigen::Vector3d vector3(const Json& object, const std::string& key, const std::string& where) {
  const Json& values = array(object, key, where);
  const bool sound =
      values.size() == 3 && std::all_of(values.begin(), values.end(), [](const Json& v) { return v.is_number(); });
  const Eigen::Vector3d result =
      sound ? Eigen::Vector3d(values[0].get<double>(), values[1].get<double>(), values[2].get<double>())
            : Eigen::Vector3d::Constant(NAN);
  if (!result.allFinite()) bad_data(where, ": ", key, " is not a list of 3 finite numbers");
  return result;
}

Eigen::Matrix4d checked_pose(const Eigen::Matrix4d& given, const std::string& where) {
  const Eigen::Matrix4d pose = rigid(given, where);
  if (pose.topRightCorner<3, 1>().cwiseAbs().maxCoeff() < kFarthestOfLog) return pose;
  bad_data(where, ": is more than ", kFarthestOfLog, " m from the origin; subtract one offset from ",
           "all positions, so that they start near 0");
}

Eigen::Matrix4d read_pose(const Json& object, const std::string& key, const std::string& where) {
  return checked_pose(matrix4(object, key, where), text(where, ": ", key));
}

// world_from_box, or position and yaw; yaw 0 looks along the world's y, as the box's own axes do.
Eigen::Matrix4d read_box_pose(const Json& box, const std::string& where) {
  if (box.is_object() && box.contains("world_from_box")) return read_pose(box, "world_from_box", where);
  const Eigen::Matrix3d turn = turn_about_z(number(box, "yaw", where));
  return checked_pose(pose_from(turn, vector3(box, "position", where)), text(where, ": position"));
}

class RigReader {
 public:
  RigReader(const fs::path& root, const ReadOptions& options)
      : log_(root, "rig", options), options_(options), json_(parse_json_file(root / kFile)) {}

  Scene read() {
    cameras_ = &member(json_, "cameras", kFile);
    if (!cameras_->is_object()) bad_data(kFile, ": cameras is not an object that maps names to cameras");
    scene_.night = flag(json_, "night", false, kFile);
    read_sweeps();
    read_frames();
    read_actors();
    if (extra_images_ > 0) {
      scene_.warnings.push_back(
          text(extra_images_, " of ", scene_.frames_listed,
               " images are left out: a step takes the image nearest in time from each camera; steps ",
               "(sweeps, if there are any) run ", moments_.range()));
    }
    return log_.finish({kFile, "sweeps in rig.json", "actors in rig.json"});
  }

 private:
  void read_sweeps() {
    const Json& sweeps = entries(json_, "sweeps");
    for (std::size_t i = 0; i < sweeps.size(); ++i) {
      log_.guarded("sweep", [&] { read_sweep(sweeps[i], text(kFile, ": sweeps[", i, "]")); });
    }
    std::stable_sort(scene_.sweeps.begin(), scene_.sweeps.end(),
                     [](const Sweep& a, const Sweep& b) { return a.timestamp < b.timestamp; });
    std::vector<double> times;
    for (Sweep& sweep : scene_.sweeps) {
      sweep.step = int(times.size());
      if (!times.empty() && times.back() == sweep.timestamp)
        bad_data(kFile, ": two sweeps have the timestamp ", sweep.timestamp,
                 "; write the points of several LiDARs into one file");
      times.push_back(sweep.timestamp);
    }
    moments_ = Moments(std::move(times));
  }

  void read_sweep(const Json& json, const std::string& where) {
    Sweep sweep;
    sweep.file = path_named(scene_.root, string(json, "points", where), options_.allow_outside);
    const std::string extension = fs::path(sweep.file).extension().string();
    if (extension != ".ply" && extension != ".npy")
      bad_data(where, ": points is ", printable(sweep.file), ", want a .ply or .npy file");
    sweep.timestamp = number(json, "timestamp", where);
    sweep.world_from_lidar = read_pose(json, "world_from_lidar", where);
    sweep.points_in_world = flag(json, "points_in_world", false, where);
    if (has_file(scene_.root / sweep.file))
      scene_.sweeps.push_back(std::move(sweep));
    else
      log_.missing(sweep.file);
  }

  void read_frames() {
    const Json& frames = array(json_, "frames", kFile);
    scene_.frames_listed = frames.size();
    std::vector<Frame> read;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      log_.guarded("frame", [&] { read_frame(frames[i], text(kFile, ": frames[", i, "]"), read); });
    }
    if (moments_.empty()) moments_ = moments_of_images(read);
    scene_.frames = nearest_frames(read, moments_);
    extra_images_ = read.size() - scene_.frames.size();
    if (!read.empty() && scene_.frames.empty())
      bad_data(kFile, ": no timestamp in frames is near one in sweeps, which run ", moments_.range(),
               ": do both come from the same clock?");
  }

  static Moments moments_of_images(const std::vector<Frame>& frames) {
    std::map<std::string, std::vector<double>> times;
    for (const Frame& frame : frames) times[frame.sensor].push_back(*frame.timestamp);
    std::vector<double> most;
    for (auto& [sensor, own] : times) {
      if (own.size() > most.size()) most = std::move(own);
    }
    return Moments(std::move(most));
  }

  void read_frame(const Json& json, const std::string& where, std::vector<Frame>& read) {
    Frame frame;
    frame.name = string(json, "image", where);
    frame.image = path_named(scene_.root, frame.name, options_.allow_outside);
    const fs::path image = scene_.root / frame.image;
    frame.sensor = string(json, "camera", where);
    frame.timestamp = number(json, "timestamp", where);
    frame.world_from_camera = read_pose(json, "world_from_camera", where);
    frame.mask = optional_string(json, "mask", where);
    if (frame.mask) frame.mask = path_named(scene_.root, *frame.mask, options_.allow_outside);
    if (frame.mask && !has_file(scene_.root / *frame.mask)) bad_data(where, ": the mask ", *frame.mask, " is missing");
    const Json& camera = camera_of(frame.sensor, where);
    if (!has_file(image)) {
      log_.missing(frame.image);
      return;
    }
    const std::string place = text(kFile, ": cameras: ", frame.sensor);
    frame.camera = find_or_add(scene_.cameras, read_camera_json(camera, camera, image, place));
    read.push_back(std::move(frame));
  }

  const Json& camera_of(const std::string& name, const std::string& where) const {
    const auto found = cameras_->find(name);
    if (found != cameras_->end() && found->is_object() && name == printable(name)) return *found;
    std::vector<std::string> names;
    for (const auto& [other, camera] : cameras_->items()) names.push_back(printable(other));
    bad_data(where, ": camera is ", printable(name), ", which is not defined in cameras", did_you_mean(name, names));
  }

  void read_actors() {
    const Json& actors = entries(json_, "actors");
    for (std::size_t i = 0; i < actors.size(); ++i) {
      const std::string where = text(kFile, ": actors[", i, "]");
      log_.guarded("actor", [&] { read_actor(actors[i], where); });
    }
  }

  void read_actor(const Json& json, const std::string& where) {
    LabelledBox labelled;
    labelled.id = printable(string(json, "id", where));
    labelled.label = printable(string(json, "label", where));
    labelled.size = vector3(json, "size", where);
    labelled.stationary = flag(json, "stationary", false, where);
    if (!ids_.insert(labelled.id).second) bad_data(where, ": id: two actors have the id ", labelled.id);
    std::map<int, std::pair<ActorBox, std::string>> boxes;  // by step, the nearest in time
    const Json& listed = array(json, "boxes", where);
    for (std::size_t i = 0; i < listed.size(); ++i) {
      const std::string place = text(where, ".boxes[", i, "]");
      ActorBox box;
      box.timestamp = number(listed[i], "timestamp", place);
      box.world_from_box = read_box_pose(listed[i], place);
      if (moments_.empty() || !moments_.near(box.timestamp)) continue;
      box.step = moments_.nearest(box.timestamp);
      const auto [found, first] = boxes.emplace(box.step, std::pair(box, place));
      if (moments_.distance(box.timestamp) < moments_.distance(found->second.first.timestamp))
        found->second = {box, place};
    }
    for (const auto& [step, box] : boxes) {
      labelled.box = box.first;
      log_.add(labelled, box.second);
    }
  }

  LogBuilder log_;
  Scene& scene_ = log_.scene;
  ReadOptions options_;
  Json json_;
  const Json* cameras_ = nullptr;
  Moments moments_;
  std::set<std::string> ids_;
  std::size_t extra_images_ = 0;
};

}  // namespace

bool is_rig(const fs::path& root) { return is_file(root / kFile); }

Scene read_rig(const fs::path& root, const ReadOptions& options) { return RigReader(root, options).read(); }

}  // namespace cloam
