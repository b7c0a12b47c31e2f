// Doubles are written with all their digits, so that a rebuilt model is the same to the bit. The boxes of actors lie in
// a file of their own (box_file.h), of which each actor has a part.
#include "models/runs/scene_file.h"

#include <nlohmann/json.hpp>

#include "models/data/recording_file.h"
#include "models/io/commit.h"
#include "models/io/json.h"
#include "models/runs/box_file.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kSceneSchema = 3, kBoxesInJson = 2;
const char* const kModels[] = {"pinhole", "opencv", "fisheye", "fov"};

Json to_json(const Camera& c) {
  return {{"width", c.width}, {"height", c.height},
          {"fx", c.fx},       {"fy", c.fy},
          {"cx", c.cx},       {"cy", c.cy},
          {"k", c.k},         {"p1", c.p1},
          {"p2", c.p2},       {"denominator", c.denominator},
          {"prism", c.prism}, {"model", kModels[static_cast<int>(c.model)]}};
}

Json to_json(const Eigen::Matrix4d& m) {
  Json rows = Json::array();
  for (int r = 0; r < 4; ++r) rows.push_back({m(r, 0), m(r, 1), m(r, 2), m(r, 3)});
  return rows;
}

const char* const kSplits[] = {"train", "test", "unused"};

Json to_json(const Frame& f) {
  Json json = {{"image", f.image},
               {"name", f.name},
               {"camera", f.camera},
               {"split", kSplits[static_cast<int>(f.split)]},
               {"world_from_camera", to_json(f.world_from_camera)}};
  if (f.timestamp) json["timestamp"] = *f.timestamp;
  if (!f.sensor.empty()) json["sensor"] = f.sensor;
  if (!f.sensor.empty()) json["step"] = f.step;
  return json;
}

Json to_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Json to_json(const Sweep& s) {
  Json json = {{"file", s.file},
               {"timestamp", s.timestamp},
               {"step", s.step},
               {"split", kSplits[static_cast<int>(s.split)]},
               {"world_from_lidar", to_json(s.world_from_lidar)}};
  if (s.velocity) json["velocity"] = to_json(*s.velocity);
  if (s.second_lidar) json["second_lidar"] = to_json(*s.second_lidar);
  return json;
}

/// first_box: its place in the file of boxes; then that of the next actor.
Json to_json(const Actor& a, std::size_t& first_box) {
  Json json = {{"id", a.id},
               {"label", a.label},
               {"size", {a.size.x(), a.size.y(), a.size.z()}},
               {"stationary", a.stationary},
               {"boxes", a.boxes.size()}};
  if (!a.boxes.empty()) json["first_box"] = first_box;
  if (a.follows_path) json["follows_path"] = true;
  if (a.asset) json["asset"] = {{"scene", a.asset->scene}, {"actor_id", a.asset->actor_id}};
  first_box += a.boxes.size();
  return json;
}

Json to_json(const Scene& scene, std::size_t& first_box) {
  Json json = {{"format", scene.format},
               {"metric", scene.metric},
               {"has_alpha", scene.has_alpha},
               {"has_test_split", scene.has_test_split},
               {"synthetic_bounds", scene.hints.synthetic_bounds},
               {"is_log", scene.is_log},
               {"night", scene.night},
               {"up", {scene.up.x(), scene.up.y(), scene.up.z()}}};
  if (scene.hints.aabb_scale) json["aabb_scale"] = *scene.hints.aabb_scale;
  if (scene.hints.nearest) json["nearest"] = *scene.hints.nearest;
  if (scene.recording != Recording{}) json["recording"] = to_json(scene.recording);
  for (const char* list : {"cameras", "frames", "sweeps", "actors"}) json[list] = Json::array();
  for (const Camera& camera : scene.cameras) json["cameras"].push_back(to_json(camera));
  for (const Frame& frame : scene.frames) json["frames"].push_back(to_json(frame));
  for (const Sweep& sweep : scene.sweeps) json["sweeps"].push_back(to_json(sweep));
  for (const Actor& actor : scene.actors) json["actors"].push_back(to_json(actor, first_box));
  return json;
}

int whole(const Json& json, const char* key, int least, int most, const std::string& where) {
  const double value = number(json, key, where);
  if (value < least || value > most) throw Error(Fault::data, text(where, ": \"", key, "\" is ", value));
  return static_cast<int>(value);
}

constexpr int kMaxScenes = 1 << 16;

Split split_from(const Json& json, const std::string& where) {
  const std::string word = string(json, "split", where);
  for (int i = 0; i < 3; ++i)
    if (word == kSplits[i]) return static_cast<Split>(i);
  throw Error(Fault::data, text(where, ": \"split\" is ", word.substr(0, 40), ", want train, test or unused"));
}

double element(const Json& list, std::size_t index, std::size_t size, const std::string& where) {
  if (list.size() != size || !list[index].is_number()) throw Error(Fault::data, where + ": want numbers");
  return list[index].get<double>();
}

// Absent in files written before lenses had them: zeros.
template <std::size_t size>
void read_numbers(const Json& json, const char* key, std::array<double, size>& numbers, const std::string& where) {
  if (!json.contains(key)) return;
  for (std::size_t i = 0; i < size; ++i) numbers[i] = element(array(json, key, where), i, size, text(where, ", ", key));
}

Camera camera_from(const Json& json, const std::string& where) {
  Camera c;
  c.width = whole(json, "width", 1, 1 << 16, where);
  c.height = whole(json, "height", 1, 1 << 16, where);
  c.fx = number(json, "fx", where);
  c.fy = number(json, "fy", where);
  c.cx = number(json, "cx", where);
  c.cy = number(json, "cy", where);
  read_numbers(json, "k", c.k, where);
  c.p1 = number(json, "p1", where);
  c.p2 = number(json, "p2", where);
  read_numbers(json, "denominator", c.denominator, where);
  read_numbers(json, "prism", c.prism, where);
  const std::string model = string(json, "model", where);
  for (std::size_t i = 0; i < std::size(kModels); ++i)
    if (model == kModels[i]) c.model = static_cast<CameraModel>(i);
  return c;
}

Frame frame_from(const Json& json, int cameras, const std::string& where) {
  Frame f;
  f.image = string(json, "image", where);
  f.name = string(json, "name", where);
  f.camera = whole(json, "camera", 0, cameras - 1, where);
  f.split = split_from(json, where);
  f.world_from_camera = matrix4(json, "world_from_camera", where);
  f.timestamp = optional_number(json, "timestamp", where);
  f.sensor = optional_string(json, "sensor", where).value_or("");
  if (!f.sensor.empty()) f.step = whole(json, "step", 0, kMaxSteps, where);
  return f;
}

Eigen::Vector3d vector3(const Json& json, const char* key, const std::string& where) {
  Eigen::Vector3d v;
  for (std::size_t i = 0; i < 3; ++i)
    v[static_cast<Eigen::Index>(i)] = element(array(json, key, where), i, 3, text(where, ", ", key));
  return v;
}

Sweep sweep_from(const Json& json, const std::string& where) {
  Sweep s;
  s.file = string(json, "file", where);
  s.timestamp = number(json, "timestamp", where);
  s.step = whole(json, "step", 0, kMaxSteps, where);
  s.split = split_from(json, where);
  s.world_from_lidar = matrix4(json, "world_from_lidar", where);
  if (json.contains("velocity")) s.velocity = vector3(json, "velocity", where);
  if (json.contains("second_lidar")) s.second_lidar = vector3(json, "second_lidar", where);
  return s;
}

ActorBox box_from(const Json& json, const std::string& where) {
  ActorBox box;
  box.step = whole(json, "step", 0, kMaxSteps, where);
  box.timestamp = number(json, "timestamp", where);
  box.world_from_box = matrix4(json, "world_from_box", where);
  return box;
}

/// What an actor's boxes are taken from; nothing where scene.json lists them itself.
using AllBoxes = std::optional<std::vector<ActorBox>>;

std::vector<ActorBox> boxes_of(const Json& actor, const AllBoxes& all, const std::string& where) {
  std::vector<ActorBox> boxes;
  if (!all) {
    for (const Json& box : array(actor, "boxes", where)) boxes.push_back(box_from(box, where));
    return boxes;
  }
  const int known = static_cast<int>(all->size()), count = whole(actor, "boxes", 0, known, where);
  if (count == 0) return boxes;
  const auto first = all->begin() + whole(actor, "first_box", 0, known - count, where);
  return {first, first + count};
}

Actor actor_from(const Json& json, const AllBoxes& boxes, const std::string& where) {
  Actor a;
  a.id = string(json, "id", where);
  a.label = string(json, "label", where);
  a.size = vector3(json, "size", where);
  a.stationary = flag(json, "stationary", false, where);
  a.follows_path = flag(json, "follows_path", false, where);
  a.boxes = boxes_of(json, boxes, where + ", actor " + a.id);
  if (json.contains("asset")) {
    const Json& asset = json["asset"];
    a.asset = {whole(asset, "scene", 0, kMaxScenes, where), string(asset, "actor_id", where)};
  }
  return a;
}

Scene scene_from(const Json& json, const AllBoxes& boxes, const std::string& where) {
  Scene scene;
  scene.format = string(json, "format", where);
  scene.metric = flag(json, "metric", false, where);
  scene.has_alpha = flag(json, "has_alpha", false, where);
  scene.has_test_split = flag(json, "has_test_split", false, where);
  scene.hints.synthetic_bounds = flag(json, "synthetic_bounds", false, where);
  scene.hints.aabb_scale = optional_number(json, "aabb_scale", where);
  scene.hints.nearest = optional_number(json, "nearest", where);
  scene.is_log = flag(json, "is_log", false, where);
  scene.night = flag(json, "night", false, where);
  scene.up = vector3(json, "up", where);
  if (json.contains("recording")) scene.recording = recording_from(json["recording"], where);
  for (const Json& camera : array(json, "cameras", where)) scene.cameras.push_back(camera_from(camera, where));
  const int cameras = static_cast<int>(scene.cameras.size());
  for (const Json& frame : array(json, "frames", where)) scene.frames.push_back(frame_from(frame, cameras, where));
  if (scene.frames.empty()) throw Error(Fault::data, where + ": no frames");
  scene.frames_listed = scene.frames.size();
  for (const Json& sweep : array(json, "sweeps", where)) scene.sweeps.push_back(sweep_from(sweep, where));
  for (const Json& actor : array(json, "actors", where)) scene.actors.push_back(actor_from(actor, boxes, where));
  return scene;
}

}  // namespace

void write_scenes(const std::filesystem::path& path, const Scenes& scenes) {
  const std::filesystem::path folder = path.parent_path();
  const std::string box_file = write_boxes(folder, scenes);
  Json json = {{"schema_version", kSceneSchema}, {"scenes", Json::array()}};
  if (!box_file.empty()) json["box_file"] = box_file;
  std::size_t first_box = 0;
  for (const Scene& scene : scenes) json["scenes"].push_back(to_json(scene, first_box));
  commit_text(path, json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
  std::error_code ignored;
  for (const std::filesystem::path& old : box_files(folder))  // what no scene.json names any more
    if (old.filename() != box_file) std::filesystem::remove(old, ignored);
}

Scenes read_scene_file(const std::filesystem::path& path) {
  const Json json = parse_json_file(path);
  const std::string where = path.string();
  const double schema = number(json, "schema_version", where);
  if (schema != kSceneSchema && schema != kBoxesInJson)
    throw Error(Fault::data, where + ": written by another version of the program; train again");
  AllBoxes boxes;
  if (schema == kSceneSchema) {
    const auto box_file = optional_string(json, "box_file", where);
    boxes = box_file ? read_boxes(path.parent_path(), *box_file) : std::vector<ActorBox>();
  }
  Scenes scenes;
  for (const Json& scene : array(json, "scenes", where))
    scenes.push_back(scene_from(scene, boxes, text(where, ", scene ", scenes.size())));
  if (scenes.empty()) throw Error(Fault::data, where + ": no scenes");
  return scenes;
}

}  // namespace cloam
