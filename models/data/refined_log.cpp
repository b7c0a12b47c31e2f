// See refined_log.h.
#include "models/data/refined_log.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "models/data/data_frame.h"
#include "models/data/pandaset.h"
#include "models/data/pose_track.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// By step, then by the actor's id.
using BoxesOfSteps = std::map<int, std::map<std::string, Eigen::Matrix4d>>;

BoxesOfSteps boxes_of_steps(const std::vector<Actor>& actors) {
  BoxesOfSteps out;
  for (const Actor& actor : actors)
    for (const ActorBox& box : actor.boxes) out[box.step][actor.id] = box.world_from_box;
  return out;
}

/// Rows that the reader leaves out (what the second LiDAR saw, too) stay where they are.
DataFrame moved(const DataFrame& cuboids, const std::map<std::string, Eigen::Matrix4d>& boxes) {
  const std::vector<std::string>& ids = cuboids.texts("uuid");
  std::map<std::string, std::vector<double>> columns;
  for (const char* name : {"position.x", "position.y", "position.z", "yaw", "pitch", "roll"})
    if (cuboids.has(name)) columns[name] = cuboids.numbers(name);
  for (std::size_t row = 0; row < ids.size(); ++row) {
    const auto found = boxes.find(ids[row]);
    if (found == boxes.end()) continue;
    const Eigen::Matrix4d& pose = found->second;
    for (int axis = 0; axis < 3; ++axis) columns[std::string("position.") + "xyz"[axis]][row] = pose(axis, 3);
    const CuboidTurn turn = cuboid_turn(pose);
    for (const auto& [name, angle] : {std::pair("yaw", turn.yaw), {"pitch", turn.pitch}, {"roll", turn.roll}})
      if (const auto column = columns.find(name); column != columns.end()) column->second[row] = angle;
  }
  DataFrame out;
  for (const Column& column : cuboids.columns()) {
    if (std::holds_alternative<std::monostate>(column.values)) continue;
    const auto changed = columns.find(column.name);
    out.add({column.name, changed == columns.end() ? column.values : ColumnValues(changed->second)});
  }
  return out;
}

/// Of "annotations/cuboids/07.pkl.gz"; -1 for any other file.
int step_of_cuboids(const fs::path& name) {
  const std::string stem = name.stem().stem().string();
  const bool is_number = !stem.empty() && stem.size() < 9 &&
                         std::all_of(stem.begin(), stem.end(), [](unsigned char c) { return std::isdigit(c); });
  return name.parent_path() == fs::path("annotations") / "cuboids" && is_number ? std::stoi(stem) : -1;
}

/// By camera, then by step: what comes behind the poses of its photos.
using MovesOfSteps = std::map<std::string, std::map<int, Eigen::Matrix4d>>;

MovesOfSteps moves_of(const Scene& log, const std::map<std::string, Eigen::Matrix4d>& poses) {
  MovesOfSteps out;
  for (const Frame& frame : log.frames)
    if (const auto found = poses.find(frame.name); found != poses.end())
      out[frame.sensor][frame.step] = frame.world_from_camera.inverse() * found->second;
  return out;
}

/// The camera of "camera/front_camera/poses.json", if that is the file's name in its folder; else empty.
std::string camera_of(const fs::path& name, const char* file) {
  const fs::path folder = name.parent_path();
  const bool is_it = name.filename() == file && folder.parent_path() == fs::path("camera");
  return is_it ? folder.filename().string() : "";
}

Json moved(const PoseTrack& track, const std::map<int, Eigen::Matrix4d>& moves) {
  Json entries = Json::array();
  for (int step = 0; step < track.steps(); ++step) {
    const auto move = moves.find(step);
    entries.push_back(pose_entry(move == moves.end() ? track.pose(step) : track.pose(step) * move->second));
  }
  return entries;
}

Json changed(Json intrinsics, const LensChange& change) {
  Camera camera;
  const std::array<std::pair<const char*, double*>, 4> lengths = {
      {{"fx", &camera.fx}, {"fy", &camera.fy}, {"cx", &camera.cx}, {"cy", &camera.cy}}};
  for (const auto& [name, length] : lengths) *length = intrinsics.at(name).get<double>();
  camera = with_lens(camera, change);
  for (const auto& [name, length] : lengths) intrinsics[name] = *length;
  return intrinsics;
}

/// Relative to the root, also behind links to folders; listed before any is written, for `folder` may lie in the root.
std::vector<fs::path> files_below(const fs::path& root) {
  std::vector<fs::path> names;
  for (const auto& entry : fs::recursive_directory_iterator(root, fs::directory_options::follow_directory_symlink))
    if (entry.is_regular_file()) names.push_back(entry.path().lexically_relative(root));
  return names;
}

}  // namespace

bool has_room_for(const RefinedLog& refined, const Scene& log) {
  const bool cameras_stay = refined.poses.empty() && refined.lenses.empty();
  const bool cameras_alone = !log.recording.front_from_lidar && log.recording.image_stamp == 0;
  return log.format == "PandaSet" && (cameras_stay || cameras_alone);
}

void write_refined_log(const fs::path& folder, const Scene& log, const RefinedLog& refined) {
  const BoxesOfSteps boxes = boxes_of_steps(refined.actors);
  const MovesOfSteps moves = moves_of(log, refined.poses);
  for (const fs::path& name : files_below(log.root)) {
    if (const auto camera = moves.find(camera_of(name, "poses.json")); camera != moves.end()) {
      const PoseTrack track(log.root, name.parent_path().string());
      commit_text(folder / name, moved(track, camera->second).dump(1) + "\n");
      continue;
    }
    if (const auto lens = refined.lenses.find(camera_of(name, "intrinsics.json")); lens != refined.lenses.end()) {
      commit_text(folder / name, changed(parse_json_file(log.root / name), lens->second).dump(1) + "\n");
      continue;
    }
    const auto found = boxes.find(step_of_cuboids(name));
    if (found == boxes.end()) {
      commit_link(log.root / name, folder / name);
      continue;
    }
    fs::path packed = folder / name;
    if (packed.extension() != ".gz") packed += ".gz";
    write_data_frame(packed, moved(read_data_frame(log.root / name), found->second));
  }
}

}  // namespace cloam
