// See resting_scene.h. What is packed: the numbers as they lie in memory, texts and lists with their lengths before
// them, field by field; then gzip, to which poses that repeat cost little.
#include "models/scene/resting_scene.h"

#include <array>
#include <concepts>
#include <type_traits>

#include "models/io/bytes.h"
#include "models/io/gzip.h"

namespace cloam {
namespace {

template <class T, class Record>
concept Is = std::same_as<std::remove_const_t<T>, Record>;

// The fields of each record, for packing and for unpacking. The bindings name all of them: one that is new does not
// compile until it is here.

template <class Each, Is<Camera> T>
void each_field(Each& each, T& camera) {
  auto& [width, height, fx, fy, cx, cy, model, k, p1, p2, denominator, prism] = camera;
  each(width, height, fx, fy, cx, cy, model, k, p1, p2, denominator, prism);
}

template <class Each, Is<DepthMap> T>
void each_field(Each& each, T& depth) {
  auto& [file, confidence, unit, along_ray] = depth;
  each(file, confidence, unit, along_ray);
}

template <class Each, Is<Frame> T>
void each_field(Each& each, T& frame) {
  auto& [name, image, mask, depth, linear, exposure, timestamp, world_from_camera, camera, split, sensor, step,
         ego_rows] = frame;
  each(name, image, mask, depth, linear, exposure, timestamp, world_from_camera, camera, split, sensor, step, ego_rows);
}

template <class Each, Is<Sweep> T>
void each_field(Each& each, T& sweep) {
  auto& [file, timestamp, world_from_lidar, step, split, points_in_world, velocity, second_lidar] = sweep;
  each(file, timestamp, world_from_lidar, step, split, points_in_world, velocity, second_lidar);
}

template <class Each, Is<ActorBox> T>
void each_field(Each& each, T& box) {
  auto& [step, timestamp, world_from_box] = box;
  each(step, timestamp, world_from_box);
}

template <class Each, Is<AssetName> T>
void each_field(Each& each, T& asset) {
  auto& [scene, actor_id] = asset;
  each(scene, actor_id);
}

template <class Each, Is<Actor> T>
void each_field(Each& each, T& actor) {
  auto& [id, label, size, stationary, boxes, asset, follows_path] = actor;
  each(id, label, size, stationary, boxes, asset, follows_path);
}

template <class Each, Is<SceneHints> T>
void each_field(Each& each, T& hints) {
  auto& [aabb_scale, synthetic_bounds, nearest] = hints;
  each(aabb_scale, synthetic_bounds, nearest);
}

template <class Each, Is<PointCloud> T>
void each_field(Each& each, T& cloud) {
  auto& [positions, colours] = cloud;
  each(positions, colours);
}

template <class Each, Is<CarBox> T>
void each_field(Each& each, T& car) {
  auto& [centre, size] = car;
  each(centre, size);
}

template <class Each, Is<Recording> T>
void each_field(Each& each, T& recording) {
  auto& [sweep_seconds, sweep_stamp, image_stamp, shutter, ahead, front_from_lidar, lidar_poses_wrong, second_lidar,
         car, car_rows, poses_replaced] = recording;
  each(sweep_seconds, sweep_stamp, image_stamp, shutter, ahead, front_from_lidar, lidar_poses_wrong, second_lidar, car,
       car_rows, poses_replaced);
}

template <class Each, Is<Scene> T>
void each_field(Each& each, T& scene) {
  auto& [root, part, format, up, metric, has_alpha, has_test_split, hints, cameras, frames, frames_listed, sweeps,
         actors, other_actors, cloud, is_log, night, recording, warnings] = scene;
  each(root, part, format, up, metric, has_alpha, has_test_split, hints, cameras, frames, frames_listed, sweeps, actors,
       other_actors, cloud, is_log, night, recording, warnings);
}

template <class T>
concept Plain = std::is_arithmetic_v<T> || std::is_enum_v<T>;

class Packer {
 public:
  template <class... Fields>
  void operator()(const Fields&... fields) {
    (put(fields), ...);
  }
  std::vector<std::uint8_t> bytes;

 private:
  void put_bytes(const void* from, std::size_t count) {
    const auto* first = static_cast<const std::uint8_t*>(from);
    bytes.insert(bytes.end(), first, first + count);
  }
  template <Plain T>
  void put(const T& value) {
    put_bytes(&value, sizeof value);
  }
  template <class T, int Rows, int Columns>
  void put(const Eigen::Matrix<T, Rows, Columns>& matrix) {
    put_bytes(matrix.data(), sizeof(T) * static_cast<std::size_t>(matrix.size()));
  }
  template <class T, std::size_t N>
  void put(const std::array<T, N>& values) {
    put_bytes(values.data(), sizeof values);
  }
  void put(const std::string& text) {
    put(text.size());
    put_bytes(text.data(), text.size());
  }
  void put(const std::filesystem::path& path) { put(path.string()); }
  template <class T>
  void put(const std::optional<T>& value) {
    put(value.has_value());
    if (value) put(*value);
  }
  template <class T>
  void put(const std::vector<T>& list) {
    put(list.size());
    if constexpr (Plain<T>) return put_bytes(list.data(), sizeof(T) * list.size());
    for (const T& one : list) put(one);
  }
  void put(const std::map<std::string, double>& values) {
    put(values.size());
    for (const auto& [name, value] : values) (*this)(name, value);
  }
  template <class T>
  void put(const T& record) {
    each_field(*this, record);
  }
};

class Unpacker {
 public:
  explicit Unpacker(std::span<const std::uint8_t> bytes) : reader_(bytes, "a packed scene") {}
  template <class... Fields>
  void operator()(Fields&... fields) {
    (get(fields), ...);
  }

 private:
  std::span<const std::uint8_t> take(std::size_t count) { return reader_.take(count, "a field"); }
  void get_bytes(void* to, std::size_t count) {
    const auto from = take(count);
    if (count > 0) std::memcpy(to, from.data(), count);
  }
  std::size_t length() { return reader_.little<std::size_t>("a length"); }
  template <Plain T>
  void get(T& value) {
    get_bytes(&value, sizeof value);
  }
  template <class T, int Rows, int Columns>
  void get(Eigen::Matrix<T, Rows, Columns>& matrix) {
    get_bytes(matrix.data(), sizeof(T) * static_cast<std::size_t>(matrix.size()));
  }
  template <class T, std::size_t N>
  void get(std::array<T, N>& values) {
    get_bytes(values.data(), sizeof values);
  }
  void get(std::string& text) {
    const auto from = take(length());
    text.assign(from.begin(), from.end());
  }
  void get(std::filesystem::path& path) {
    std::string text;
    get(text);
    path = text;
  }
  template <class T>
  void get(std::optional<T>& value) {
    if (reader_.little<bool>("a choice")) get(value.emplace());
  }
  /// No length is believed before there are bytes for it.
  template <class T>
  void get(std::vector<T>& list) {
    const std::size_t count = length();
    if (count > reader_.remaining()) (void)take(count);
    list.resize(count);
    if constexpr (Plain<T>) return get_bytes(list.data(), sizeof(T) * count);
    for (T& one : list) get(one);
  }
  void get(std::map<std::string, double>& values) {
    for (std::size_t left = length(); left > 0; --left) {
      std::string name;
      get(name);
      get(values[name]);
    }
  }
  template <class T>
  void get(T& record) {
    each_field(*this, record);
  }

  ByteReader reader_;
};

std::vector<std::uint8_t> plain_bytes(const Scene& scene) {
  Packer pack;
  pack(scene);
  return std::move(pack.bytes);
}

Stored<Scene> rested(const Scene& scene, const std::shared_ptr<HostStore>& store) {
  const std::vector<std::uint8_t> plain = plain_bytes(scene);
  auto bytes = std::make_shared<std::vector<std::uint8_t>>(gzip(plain));
  bytes->shrink_to_fit();
  return {store, 1, [bytes](std::size_t) { return unpacked_scene(*bytes); },
          [size = std::uint64_t{plain.size()}](std::size_t) { return size; }};
}

}  // namespace

std::vector<std::uint8_t> packed(const Scene& scene) { return gzip(plain_bytes(scene)); }

Scene unpacked_scene(std::span<const std::uint8_t> bytes) {
  const std::vector<std::uint8_t> plain = gunzip(bytes, most_unpacked(bytes.size()), "a packed scene");
  Scene scene;
  Unpacker unpack(plain);
  unpack(scene);
  return scene;
}

RestingScene::RestingScene(Scene scene) : scene_(std::vector<Scene>{std::move(scene)}) {}

RestingScene::RestingScene(const Scene& scene, const std::shared_ptr<HostStore>& store)
    : scene_(rested(scene, store)) {}

}  // namespace cloam
