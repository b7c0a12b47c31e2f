// Doubles are written with all their digits, so that a rebuilt model is the same to the bit.
#include "models/train/scene_file.h"

#include "models/data/json.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

const char* const kModels[] = {"pinhole", "opencv", "fisheye"};

Json to_json(const Camera& c) {
  return {{"width", c.width}, {"height", c.height},
          {"fx", c.fx},       {"fy", c.fy},
          {"cx", c.cx},       {"cy", c.cy},
          {"k", c.k},         {"p1", c.p1},
          {"p2", c.p2},       {"model", kModels[static_cast<int>(c.model)]}};
}

Json to_json(const Eigen::Matrix4d& m) {
  Json rows = Json::array();
  for (int r = 0; r < 4; ++r) rows.push_back({m(r, 0), m(r, 1), m(r, 2), m(r, 3)});
  return rows;
}

Json to_json(const Frame& f) {
  return {{"image", f.image},
          {"name", f.name},
          {"camera", f.camera},
          {"split", f.split == Split::test ? "test" : "train"},
          {"world_from_camera", to_json(f.world_from_camera)}};
}

int whole(const Json& json, const char* key, int least, int most, const std::string& where) {
  const double value = number(json, key, where);
  if (value < least || value > most) throw Error(Fault::data, text(where, ": \"", key, "\" is ", value));
  return static_cast<int>(value);
}

double element(const Json& list, std::size_t index, std::size_t size, const std::string& where) {
  if (list.size() != size || !list[index].is_number()) throw Error(Fault::data, where + ": want numbers");
  return list[index].get<double>();
}

Camera camera_from(const Json& json, const std::string& where) {
  Camera c;
  c.width = whole(json, "width", 1, 1 << 16, where);
  c.height = whole(json, "height", 1, 1 << 16, where);
  c.fx = number(json, "fx", where);
  c.fy = number(json, "fy", where);
  c.cx = number(json, "cx", where);
  c.cy = number(json, "cy", where);
  for (std::size_t i = 0; i < 4; ++i) c.k[i] = element(array(json, "k", where), i, 4, where + ", k");
  c.p1 = number(json, "p1", where);
  c.p2 = number(json, "p2", where);
  const std::string model = string(json, "model", where);
  for (int i = 0; i < 3; ++i)
    if (model == kModels[i]) c.model = static_cast<CameraModel>(i);
  return c;
}

Frame frame_from(const Json& json, int cameras, const std::string& where) {
  Frame f;
  f.image = string(json, "image", where);
  f.name = string(json, "name", where);
  f.camera = whole(json, "camera", 0, cameras - 1, where);
  f.split = string(json, "split", where) == "test" ? Split::test : Split::train;
  f.world_from_camera = matrix4(json, "world_from_camera", where);
  return f;
}

}  // namespace

void write_scene(const std::filesystem::path& path, const Scene& scene) {
  Json json = {{"schema_version", 1},
               {"format", scene.format},
               {"metric", scene.metric},
               {"has_alpha", scene.has_alpha},
               {"has_test_split", scene.has_test_split},
               {"synthetic_bounds", scene.hints.synthetic_bounds},
               {"up", {scene.up.x(), scene.up.y(), scene.up.z()}},
               {"cameras", Json::array()},
               {"frames", Json::array()}};
  if (scene.hints.aabb_scale) json["aabb_scale"] = *scene.hints.aabb_scale;
  for (const Camera& camera : scene.cameras) json["cameras"].push_back(to_json(camera));
  for (const Frame& frame : scene.frames) json["frames"].push_back(to_json(frame));
  commit_text(path, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

Scene read_scene_file(const std::filesystem::path& path) {
  const Json json = parse_json_file(path);
  const std::string where = path.string();
  Scene scene;
  scene.format = string(json, "format", where);
  scene.metric = flag(json, "metric", false, where);
  scene.has_alpha = flag(json, "has_alpha", false, where);
  scene.has_test_split = flag(json, "has_test_split", false, where);
  scene.hints.synthetic_bounds = flag(json, "synthetic_bounds", false, where);
  scene.hints.aabb_scale = optional_number(json, "aabb_scale", where);
  for (std::size_t i = 0; i < 3; ++i)
    scene.up[static_cast<Eigen::Index>(i)] = element(array(json, "up", where), i, 3, where + ", up");
  for (const Json& camera : array(json, "cameras", where)) scene.cameras.push_back(camera_from(camera, where));
  const int cameras = static_cast<int>(scene.cameras.size());
  for (const Json& frame : array(json, "frames", where)) scene.frames.push_back(frame_from(frame, cameras, where));
  if (scene.frames.empty()) throw Error(Fault::data, where + ": no frames");
  scene.frames_listed = scene.frames.size();
  return scene;
}

}  // namespace cloam
